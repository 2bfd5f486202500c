/* Conforming subdivision of a triangle mesh that lies on a base mesh: find the edges that are too long once mapped,
 * place their midpoints on the base mesh, split the faces, flip edges that are not Delaunay.
 *
 * A mesh is three arrays over its faces: `corners` (vertices), `twins` (half-edge 3 f + i runs from corner i to corner
 * i + 1 of face f; its twin is the half-edge on the other side, -1 at a boundary) and `home` (the base face that the
 * face lies in). A vertex is a point of the base mesh: a base face and barycentric weights in it.
 */
#include "arrays.h"
#include <math.h>
#include <stdlib.h>

#define NEXT(i) ((i) == 2 ? 0 : (i) + 1)
#define THINNEST 0.25 /* altitude over longest edge */
#define MOST_CHILDREN 4
#define PATTERNS 11 /* by the mask of split edges; the three masks of two edges have one pattern for each diagonal */

static double squared_distance(const double *points, int32_t a, int32_t b)
{
    const double *p = points + 3 * (Py_ssize_t)a, *q = points + 3 * (Py_ssize_t)b;
    double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
    return x * x + y * y + z * z;
}

/* ---- finding edges and placing midpoints ---- */

/* The longest edge on the base mesh of a face that is thinner than THINNEST across it; -1 where it is not thin. */
static int edge_along(const double *base, const int32_t *corner)
{
    double length[3], product = 0.0;
    for (int i = 0; i < 3; i++)
        length[i] = squared_distance(base, corner[i], corner[NEXT(i)]);
    int i = length[0] >= length[1] && length[0] >= length[2] ? 0 : length[1] >= length[2] ? 1 : 2;
    const double *a = base + 3 * (Py_ssize_t)corner[i], *b = base + 3 * (Py_ssize_t)corner[NEXT(i)];
    const double *c = base + 3 * (Py_ssize_t)corner[NEXT(NEXT(i))];
    for (int k = 0; k < 3; k++)
        product += (b[k] - a[k]) * (c[k] - a[k]);
    double altitude = length[NEXT(NEXT(i))] * length[i] - product * product; /* squared, times the squared length */
    return altitude < THINNEST * THINNEST * length[i] * length[i] ? i : -1;
}

/* In a thin face with an edge to be split, split the edge along it too; so in the face beyond, and so on. */
static void mark_along(int32_t *marks, const int32_t *corners, const int32_t *twins, const double *base, Py_ssize_t face)
{
    while (1) {
        int i = edge_along(base, corners + 3 * face);
        if (i < 0 || marks[3 * face + i])
            return;
        int32_t twin = twins[3 * face + i];
        marks[3 * face + i] = 1;
        if (twin < 0)
            return;
        marks[twin] = 1;
        face = twin / 3;
    }
}

/* Number the midpoints of edges to be split, in order of their first half-edge, from `next` on: those longer than the
 * limit, and what `mark_along` adds. The ends of an edge may meet where the surface between them is far away, and then
 * all points near the edge are far from them: without that rule the faces beside the edge would be split for ever,
 * into ever thinner ones. With it (Rivara's longest-edge propagation, for thin faces) every split takes a fixed share
 * of a face's area or of its length, so splitting ends once the faces are small enough for a Lipschitz map. */
static Py_ssize_t number_midpoints(int32_t *midpoint, const int32_t *corners, const int32_t *twins, Py_ssize_t faces,
                                   const double *mapped, const double *base, double limit, Py_ssize_t next)
{
    Py_ssize_t first = next;
    for (Py_ssize_t h = 0; h < 3 * faces; h++)
        midpoint[h] = squared_distance(mapped, corners[h], corners[h - h % 3 + NEXT(h % 3)]) > limit * limit;
    for (Py_ssize_t f = 0; f < faces; f++)
        if (midpoint[3 * f] || midpoint[3 * f + 1] || midpoint[3 * f + 2])
            mark_along(midpoint, corners, twins, base, f);
    for (Py_ssize_t h = 0; h < 3 * faces; h++) {
        if (twins[h] >= 0 && twins[h] < h)
            midpoint[h] = midpoint[twins[h]];
        else
            midpoint[h] = midpoint[h] && next < INT32_MAX ? (int32_t)next++ : -1;
    }
    return next - first;
}

/* The weights of a point of base face `own` in base face `face`, whose closure holds it too. */
static void weights_in(const int32_t *base, int32_t face, int32_t own, const double *weights, double *out)
{
    for (int j = 0; j < 3; j++) {
        out[j] = face == own ? weights[j] : 0.0;
        for (int k = 0; k < 3 && face != own; k++)
            if (base[3 * (Py_ssize_t)own + k] == base[3 * (Py_ssize_t)face + j])
                out[j] += weights[k];
    }
}

typedef struct {
    const int32_t *base;    /* corners of the base faces */
    const int32_t *face;    /* of each vertex */
    const double *weights;
} Points;

static void corner_weights(const Points *points, int32_t home, int32_t vertex, double *out)
{
    weights_in(points->base, home, points->face[vertex], points->weights + 3 * (Py_ssize_t)vertex, out);
}

static void place_midpoints(int32_t *new_faces, double *new_weights, const int32_t *midpoint, const int32_t *corners,
                            const int32_t *twins, const int32_t *home, Py_ssize_t faces, const Points *points,
                            Py_ssize_t first)
{
    for (Py_ssize_t h = 0; h < 3 * faces; h++) {
        if (midpoint[h] < 0 || (twins[h] >= 0 && twins[h] < h))
            continue;
        int i = (int)(h % 3);
        double a[3], b[3];
        corner_weights(points, home[h / 3], corners[h], a);
        corner_weights(points, home[h / 3], corners[h - i + NEXT(i)], b);
        Py_ssize_t row = midpoint[h] - first;
        new_faces[row] = home[h / 3];
        for (int k = 0; k < 3; k++)
            new_weights[3 * row + k] = 0.5 * (a[k] + b[k]); /* exact: the weights are dyadic */
    }
}

#include "flips.h"

/* ---- splitting faces ---- */

typedef struct {
    int children;
    int8_t corner[3 * MOST_CHILDREN]; /* 0 1 2 the face's own, 3 4 5 the midpoints of its edges 0 1 2 */
    int8_t inner[3 * MOST_CHILDREN];  /* twin inside the same face, or -1 */
    int8_t outer[3][2];               /* half-edge on edge i: its only or first half, and its second half */
} Pattern;

/* Patterns turned so that edge 0 is the one that is split (or, of two, the one that is not). */
static const int8_t ONE[] = {0, 3, 2, 3, 1, 2};
static const int8_t TWO_A[] = {0, 1, 4, 0, 4, 5, 5, 4, 2};
static const int8_t TWO_B[] = {0, 1, 5, 1, 4, 5, 5, 4, 2};
static const int8_t THREE[] = {0, 3, 5, 3, 1, 4, 5, 4, 2, 3, 4, 5};
static const int8_t NONE[] = {0, 1, 2};

static void pattern_fill(Pattern *pattern, const int8_t *labels, int children, int turn)
{
    pattern->children = children;
    for (int h = 0; h < 3 * children; h++)
        pattern->corner[h] = (int8_t)((labels[h] % 3 + turn) % 3 + labels[h] / 3 * 3);
    for (int h = 0; h < 3 * children; h++) {
        int start = pattern->corner[h], end = pattern->corner[h / 3 * 3 + (h + 1) % 3];
        pattern->inner[h] = -1;
        for (int g = 0; g < 3 * children; g++)
            if (pattern->corner[g] == end && pattern->corner[g / 3 * 3 + (g + 1) % 3] == start)
                pattern->inner[h] = (int8_t)g;
        if (pattern->inner[h] >= 0)
            continue;
        if (start >= 3) /* from a midpoint to the end of its edge */
            pattern->outer[start - 3][1] = (int8_t)h;
        else
            pattern->outer[start][0] = (int8_t)h;
    }
}

/* Pattern of mask m at index m, with the other diagonal of masks 3, 5, 6 at 8, 9, 10. */
static void patterns_fill(Pattern *patterns)
{
    pattern_fill(&patterns[0], NONE, 1, 0);
    pattern_fill(&patterns[7], THREE, 4, 0);
    for (int i = 0; i < 3; i++) {
        pattern_fill(&patterns[1 << i], ONE, 2, i);
        pattern_fill(&patterns[7 ^ (1 << i)], TWO_A, 3, i);
        pattern_fill(&patterns[8 + i], TWO_B, 3, i);
    }
}

/* Pattern of one face. Where two edges are split, the rest is a quadrilateral: take its shorter diagonal. */
static uint8_t choose_pattern(const int32_t *corners, const int32_t *midpoint, const double *mapped)
{
    int mask = 0;
    for (int i = 0; i < 3; i++)
        mask |= (midpoint[i] >= 0) << i;
    for (int i = 0; i < 3; i++)
        if (mask == (7 ^ (1 << i))) {
            int j = NEXT(i), k = NEXT(j);
            if (squared_distance(mapped, corners[j], midpoint[k]) < squared_distance(mapped, corners[i], midpoint[j]))
                return (uint8_t)(8 + i);
        }
    return (uint8_t)mask;
}

typedef struct {
    const int32_t *corners, *twins, *home, *midpoint;
    const uint8_t *chosen;
    const Py_ssize_t *first; /* first child of each face */
    const Pattern *patterns;
} Parents;

static int32_t child_edge(const Parents *parents, int32_t half_edge, int part)
{
    Py_ssize_t face = half_edge / 3;
    return (int32_t)(3 * parents->first[face] + parents->patterns[parents->chosen[face]].outer[half_edge % 3][part]);
}

static void split_face(const Parents *parents, Py_ssize_t face, int32_t *corners, int32_t *twins, int32_t *home)
{
    const Pattern *pattern = &parents->patterns[parents->chosen[face]];
    Py_ssize_t first = parents->first[face];
    for (int h = 0; h < 3 * pattern->children; h++) {
        int label = pattern->corner[h];
        corners[3 * first + h] = label < 3 ? parents->corners[3 * face + label] : parents->midpoint[3 * face + label - 3];
        if (pattern->inner[h] >= 0)
            twins[3 * first + h] = (int32_t)(3 * first + pattern->inner[h]);
    }
    for (int child = 0; child < pattern->children; child++)
        home[first + child] = parents->home[face];
    for (int i = 0; i < 3; i++) {
        int32_t twin = parents->twins[3 * face + i];
        int split = parents->midpoint[3 * face + i] >= 0;
        twins[3 * first + pattern->outer[i][0]] = twin < 0 ? -1 : child_edge(parents, twin, split);
        if (split)
            twins[3 * first + pattern->outer[i][1]] = twin < 0 ? -1 : child_edge(parents, twin, 0);
    }
}

/* ---- interface ---- */

static int rows_are(const Array *array, Py_ssize_t rows, const char *name)
{
    if (array->rows == rows)
        return 1;
    PyErr_Format(PyExc_ValueError, "%s: need %zd rows, got %zd", name, rows, array->rows);
    return 0;
}

static int in_range(const Array *array, int32_t least, Py_ssize_t limit, const char *name)
{
    const int32_t *index = array->data;
    for (Py_ssize_t i = 0; i < array->rows * array->columns; i++)
        if (index[i] < least || index[i] >= limit) {
            PyErr_Format(PyExc_IndexError, "%s: index %d is outside [%d, %zd)", name, index[i], least, limit);
            return 0;
        }
    return 1;
}

/* mark(midpoint i(f,3), corners i(f,3), twins i(f,3), mapped d(n,3), base d(n,3), limit) -> number of edges to split */
static PyObject *mark(PyObject *self, PyObject *args)
{
    PyObject *o[5], *result = NULL;
    double limit;
    Arrays a;
    static const int columns[] = {3, 3, 3, 3, 3};
    if (!PyArg_ParseTuple(args, "OOOOOd", &o[0], &o[1], &o[2], &o[3], &o[4], &limit)
        || arrays_get(&a, o, "iiidd", columns, NULL, 1) < 0)
        return NULL;
    Array *x = a.array;
    Py_ssize_t faces = x[1].rows, vertices = x[3].rows, count;
    if (rows_are(&x[0], faces, "midpoint") && rows_are(&x[2], faces, "twins") && rows_are(&x[4], vertices, "base")
        && in_range(&x[1], 0, vertices, "corners") && in_range(&x[2], -1, 3 * faces, "twins")) {
        Py_BEGIN_ALLOW_THREADS
        count = number_midpoints(x[0].data, x[1].data, x[2].data, faces, x[3].data, x[4].data, limit, vertices);
        Py_END_ALLOW_THREADS
        result = PyLong_FromSsize_t(count);
    }
    arrays_release(&a);
    return result;
}

/* place(new_faces i(m,), new_weights d(m,3), midpoint i(f,3), corners i(f,3), twins i(f,3), home i(f,), base i(b,3),
 *       point_faces i(n,), weights d(n,3)) */
static PyObject *place(PyObject *self, PyObject *args)
{
    PyObject *o[9], *result = NULL;
    Arrays a;
    static const int columns[] = {1, 3, 3, 3, 3, 1, 3, 1, 3};
    if (!PyArg_ParseTuple(args, "OOOOOOOOO", &o[0], &o[1], &o[2], &o[3], &o[4], &o[5], &o[6], &o[7], &o[8])
        || arrays_get(&a, o, "idiiiiiid", columns, NULL, 2) < 0)
        return NULL;
    Array *x = a.array;
    Py_ssize_t faces = x[3].rows, vertices = x[7].rows, added = x[0].rows;
    if (rows_are(&x[1], added, "new_weights") && rows_are(&x[2], faces, "midpoint") && rows_are(&x[4], faces, "twins")
        && rows_are(&x[5], faces, "home") && rows_are(&x[8], vertices, "weights")
        && in_range(&x[2], -1, vertices + added, "midpoint") && in_range(&x[3], 0, vertices, "corners")
        && in_range(&x[4], -1, 3 * faces, "twins") && in_range(&x[5], 0, x[6].rows, "home")
        && in_range(&x[7], 0, x[6].rows, "point_faces")) {
        const int32_t *midpoint = x[2].data;
        int old = 0;
        for (Py_ssize_t h = 0; h < 3 * faces; h++)
            old |= midpoint[h] >= 0 && midpoint[h] < vertices;
        if (old) {
            PyErr_SetString(PyExc_IndexError, "midpoint: names an old vertex");
        } else {
            Points points = {x[6].data, x[7].data, x[8].data};
            Py_BEGIN_ALLOW_THREADS
            place_midpoints(x[0].data, x[1].data, midpoint, x[3].data, x[4].data, x[5].data, faces, &points, vertices);
            Py_END_ALLOW_THREADS
            result = Py_NewRef(Py_None);
        }
    }
    arrays_release(&a);
    return result;
}

/* choose(chosen B(f,), midpoint i(f,3), corners i(f,3), mapped d(n,3)) -> number of faces after the split */
static PyObject *choose(PyObject *self, PyObject *args)
{
    PyObject *o[4], *result = NULL;
    Arrays a;
    static const int columns[] = {1, 3, 3, 3};
    if (!PyArg_ParseTuple(args, "OOOO", &o[0], &o[1], &o[2], &o[3]) || arrays_get(&a, o, "Biid", columns, NULL, 1) < 0)
        return NULL;
    Array *x = a.array;
    Py_ssize_t faces = x[2].rows, total = 0;
    if (rows_are(&x[0], faces, "chosen") && rows_are(&x[1], faces, "midpoint")
        && in_range(&x[1], -1, x[3].rows, "midpoint") && in_range(&x[2], 0, x[3].rows, "corners")) {
        uint8_t *chosen = x[0].data;
        const int32_t *midpoint = x[1].data, *corners = x[2].data;
        Pattern patterns[PATTERNS];
        Py_BEGIN_ALLOW_THREADS
        patterns_fill(patterns);
        for (Py_ssize_t f = 0; f < faces; f++) {
            chosen[f] = choose_pattern(corners + 3 * f, midpoint + 3 * f, x[3].data);
            total += patterns[chosen[f]].children;
        }
        Py_END_ALLOW_THREADS
        result = PyLong_FromSsize_t(total);
    }
    arrays_release(&a);
    return result;
}

/* split(new_corners i(g,3), new_twins i(g,3), new_home i(g,), chosen B(f,), midpoint i(f,3), corners i(f,3),
 *       twins i(f,3), home i(f,)) */
static PyObject *split(PyObject *self, PyObject *args)
{
    PyObject *o[8], *result = NULL;
    Arrays a;
    static const int columns[] = {3, 3, 1, 1, 3, 3, 3, 1};
    if (!PyArg_ParseTuple(args, "OOOOOOOO", &o[0], &o[1], &o[2], &o[3], &o[4], &o[5], &o[6], &o[7])
        || arrays_get(&a, o, "iiiBiiii", columns, NULL, 3) < 0)
        return NULL;
    Array *x = a.array;
    Py_ssize_t faces = x[5].rows, total = 0;
    const uint8_t *chosen = x[3].data;
    Py_ssize_t *first = malloc(sizeof *first * (size_t)(faces + 1));
    if (!first) {
        PyErr_NoMemory();
    } else if (rows_are(&x[3], faces, "chosen") && rows_are(&x[4], faces, "midpoint") && rows_are(&x[6], faces, "twins")
               && rows_are(&x[7], faces, "home") && in_range(&x[6], -1, 3 * faces, "twins")) {
        Pattern patterns[PATTERNS];
        int known = 1;
        patterns_fill(patterns);
        for (Py_ssize_t f = 0; f < faces && known; f++) {
            first[f] = total;
            known = chosen[f] < PATTERNS;
            total += known ? patterns[chosen[f]].children : 0;
        }
        if (!known || total > INT32_MAX / 3) {
            PyErr_SetString(PyExc_ValueError, "chosen: unknown pattern, or too many faces");
        } else if (rows_are(&x[0], total, "new_corners") && rows_are(&x[1], total, "new_twins")
                   && rows_are(&x[2], total, "new_home")) {
            Parents parents = {x[5].data, x[6].data, x[7].data, x[4].data, chosen, first, patterns};
            Py_BEGIN_ALLOW_THREADS
            for (Py_ssize_t f = 0; f < faces; f++)
                split_face(&parents, f, x[0].data, x[1].data, x[2].data);
            Py_END_ALLOW_THREADS
            result = Py_NewRef(Py_None);
        }
    }
    free(first);
    arrays_release(&a);
    return result;
}

/* flip(corners i(f,3), twins i(f,3), home i(f,), mapped d(n,3), base i(b,3), point_faces i(n,), weights d(n,3), limit,
 *      sweeps) -> number of flips */
static PyObject *flip_edges(PyObject *self, PyObject *args)
{
    PyObject *o[7], *result = NULL;
    double limit;
    int sweeps;
    Arrays a;
    static const int columns[] = {3, 3, 1, 3, 3, 1, 3};
    if (!PyArg_ParseTuple(args, "OOOOOOOdi", &o[0], &o[1], &o[2], &o[3], &o[4], &o[5], &o[6], &limit, &sweeps)
        || arrays_get(&a, o, "iiidiid", columns, NULL, 2) < 0)
        return NULL;
    Array *x = a.array;
    Py_ssize_t faces = x[0].rows, vertices = x[3].rows, flips = 0;
    if (rows_are(&x[1], faces, "twins") && rows_are(&x[2], faces, "home") && rows_are(&x[5], vertices, "point_faces")
        && rows_are(&x[6], vertices, "weights") && in_range(&x[0], 0, vertices, "corners")
        && in_range(&x[1], -1, 3 * faces, "twins") && in_range(&x[2], 0, x[4].rows, "home")
        && in_range(&x[5], 0, x[4].rows, "point_faces")) {
        Points points = {x[4].data, x[5].data, x[6].data};
        Py_BEGIN_ALLOW_THREADS
        for (Py_ssize_t done = 1; sweeps > 0 && done; sweeps--)
            flips += done = flip_sweep(x[0].data, x[1].data, x[2].data, faces, x[3].data, &points, limit);
        Py_END_ALLOW_THREADS
        result = PyLong_FromSsize_t(flips);
    }
    arrays_release(&a);
    return result;
}

static PyMethodDef methods[] = {
    {"mark", mark, METH_VARARGS, "Number the midpoints of edges that are too long."},
    {"place", place, METH_VARARGS, "Place the midpoints on the base mesh."},
    {"choose", choose, METH_VARARGS, "Choose how each face is split."},
    {"split", split, METH_VARARGS, "Split the faces."},
    {"flip", flip_edges, METH_VARARGS, "Flip edges towards Delaunay inside base faces."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_subdivide", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__subdivide(void) { return PyModule_Create(&module); }
