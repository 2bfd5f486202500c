/* Intrinsic Delaunay triangulation by flips on edge lengths alone (Fisher, Springborn, Schroeder, Bobenko 2007).
 *
 * All angles enter as t = tan(angle / 2). It is computed from differences of lengths, so that needles keep their
 * accuracy; the opposite angles of a Delaunay edge add up to at most pi, which is t t' <= 1.
 */
#include "arrays.h"
#include <math.h>
#include <stdlib.h>

#define TOLERANCE 1e-9 /* cotangents may add up to this much less than zero */
#define MOST_FLIPS 100 /* per half-edge; lengths without rounding need about one */

static inline int32_t next(int32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
static inline int32_t previous(int32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

typedef struct {
    int32_t *corners, *twins;
    double *lengths;
    int32_t half_edges;
} Triangulation;

/* Tangent of half the angle opposite half-edge h: infinite for a straight angle, 1 (a right one) where it has none. */
static double half_tangent(const Triangulation *mesh, int32_t h)
{
    double a = mesh->lengths[h], b = mesh->lengths[next(h)], c = mesh->lengths[previous(h)];
    double far = a + (b - c), near = a - (b - c), all = a + b + c, rest = b > c ? c + (b - a) : b + (c - a);
    double above = fmax(far, 0.0) * fmax(near, 0.0), below = all * fmax(rest, 0.0);
    if (below > 0)
        return sqrt(above / below);
    return above > 0 ? INFINITY : 1.0;
}

/* Sum of the cotangents of two angles. */
static double cotangents(double t, double s)
{
    if (isinf(t) || isinf(s))
        return t == 0 || s == 0 ? 0.0 : -INFINITY;
    if (t == 0 || s == 0)
        return INFINITY;
    return (t + s) * (1 - t * s) / (2 * t * s);
}

static void link_twins(Triangulation *mesh, int32_t h, int32_t g)
{
    mesh->twins[h] = g;
    if (g >= 0)
        mesh->twins[g] = h;
}

/* Faces (a, b, c) at h and (b, a, d) at its twin become (a, d, c) and (d, b, c), with `length` from c to d. ca and db
 * stay where they are; ad moves to h, bc to the twin. Either may be glued to another side of the same two faces. */
static void flip(Triangulation *mesh, int32_t h, double length)
{
    int32_t g = mesh->twins[h], bc = next(h), ca = previous(h), ad = next(g), db = previous(g);
    int32_t beyond_ad = mesh->twins[ad], beyond_bc = mesh->twins[bc];
    int32_t c = mesh->corners[ca], d = mesh->corners[db];
    mesh->lengths[h] = mesh->lengths[ad];
    mesh->lengths[g] = mesh->lengths[bc];
    mesh->lengths[bc] = mesh->lengths[ad] = length;
    mesh->corners[bc] = d;
    mesh->corners[ad] = c;
    link_twins(mesh, h, beyond_ad == bc ? g : beyond_ad);
    if (beyond_ad != bc)
        link_twins(mesh, g, beyond_bc);
    link_twins(mesh, bc, ad);
}

/* Flip h if the diamond is convex and the sum of the cotangents grows by it. */
static int flip_if_better(Triangulation *mesh, int32_t h)
{
    int32_t g = mesh->twins[h];
    if (g < 0 || g / 3 == h / 3)
        return 0;
    double before = cotangents(half_tangent(mesh, h), half_tangent(mesh, g));
    if (!(before < -TOLERANCE))
        return 0;
    int32_t bc = next(h), ca = previous(h), ad = next(g), db = previous(g);
    double a1 = half_tangent(mesh, bc), a2 = half_tangent(mesh, db); /* the two parts of the angles at a and b */
    double b1 = half_tangent(mesh, ca), b2 = half_tangent(mesh, ad);
    if (!(a1 * a2 < 1 && b1 * b2 < 1))
        return 0;
    if (!(cotangents((a1 + a2) / (1 - a1 * a2), (b1 + b2) / (1 - b1 * b2)) > before))
        return 0;
    double sine = (a1 + a2) * (a1 + a2) / ((1 + a1 * a1) * (1 + a2 * a2)); /* squared, of half the angle at a */
    double difference = mesh->lengths[ca] - mesh->lengths[ad];
    flip(mesh, h, sqrt(difference * difference + 4 * mesh->lengths[ca] * mesh->lengths[ad] * sine));
    return 1;
}

/* Flip until every edge is Delaunay: edges wait on a stack, and a flip sends the four around it back there. `waiting`
 * has a byte, `stack` an entry per half-edge. Returns the number of flips. */
static int64_t flip_to_delaunay(Triangulation *mesh, uint8_t *waiting, int32_t *stack)
{
    int64_t flips = 0, most = MOST_FLIPS * (int64_t)mesh->half_edges;
    int32_t count = 0;
    for (int32_t h = mesh->half_edges - 1; h >= 0; h--) {
        waiting[h] = mesh->twins[h] > h;
        if (waiting[h])
            stack[count++] = h;
    }
    while (count && flips < most) {
        int32_t h = stack[--count], g = mesh->twins[h];
        waiting[h] = 0;
        if (!flip_if_better(mesh, h))
            continue;
        flips++;
        const int32_t around[4] = {h, previous(h), g, previous(g)};
        for (int i = 0; i < 4; i++) {
            int32_t twin = mesh->twins[around[i]];
            if (twin >= 0 && !waiting[around[i]] && !waiting[twin]) {
                waiting[around[i]] = 1;
                stack[count++] = around[i];
            }
        }
    }
    return flips;
}

static void measure_lengths(const Triangulation *mesh, const double *points)
{
    for (int32_t h = 0; h < mesh->half_edges; h++) {
        const double *p = points + 3 * (Py_ssize_t)mesh->corners[h];
        const double *q = points + 3 * (Py_ssize_t)mesh->corners[next(h)];
        double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
        mesh->lengths[h] = sqrt(x * x + y * y + z * z);
    }
}

static int are_indices(const int32_t *corners, Py_ssize_t half_edges, Py_ssize_t vertices)
{
    for (Py_ssize_t h = 0; h < half_edges; h++)
        if (corners[h] < 0 || corners[h] >= vertices) {
            PyErr_Format(PyExc_IndexError, "faces: index %d is outside [0, %zd)", corners[h], vertices);
            return 0;
        }
    return 1;
}

static int are_twins(const int32_t *twins, Py_ssize_t half_edges)
{
    for (Py_ssize_t h = 0; h < half_edges; h++)
        if (twins[h] != -1 && (twins[h] < 0 || twins[h] >= half_edges || twins[h] == h || twins[twins[h]] != h)) {
            PyErr_Format(PyExc_ValueError, "twins: half-edge %zd has no other side", h);
            return 0;
        }
    return 1;
}

/* measure(faces i(f,3), lengths d(f,3), points d(n,3)): the lengths of straight sides */
static PyObject *measure(PyObject *self, PyObject *args)
{
    PyObject *o[3], *result = NULL;
    Arrays a;
    static const int columns[] = {3, 3, 3};
    static const char *const names[] = {"lengths", "faces", "points"};
    if (!PyArg_ParseTuple(args, "OOO", &o[1], &o[0], &o[2]) || arrays_get(&a, o, "did", columns, names, 1) < 0)
        return NULL;
    Array *x = a.array;
    Triangulation mesh = {x[1].data, NULL, x[0].data, (int32_t)(3 * x[1].rows)};
    if (3 * x[1].rows > INT32_MAX || x[0].rows != x[1].rows) {
        PyErr_SetString(PyExc_ValueError, "faces and lengths need the same number of rows, at most 2^31 / 3");
    } else if (are_indices(mesh.corners, mesh.half_edges, x[2].rows)) {
        measure_lengths(&mesh, x[2].data);
        result = Py_NewRef(Py_None);
    }
    arrays_release(&a);
    return result;
}

/* flip(faces i(f,3), twins i(f,3), lengths d(f,3)) -> number of flips; all three are changed */
static PyObject *flip_all(PyObject *self, PyObject *args)
{
    PyObject *o[3], *result = NULL;
    Arrays a;
    static const int columns[] = {3, 3, 3};
    static const char *const names[] = {"faces", "twins", "lengths"};
    if (!PyArg_ParseTuple(args, "OOO", &o[0], &o[1], &o[2]) || arrays_get(&a, o, "iid", columns, names, 3) < 0)
        return NULL;
    Array *x = a.array;
    Py_ssize_t half_edges = 3 * x[0].rows;
    if (half_edges > INT32_MAX || x[1].rows != x[0].rows || x[2].rows != x[0].rows) {
        PyErr_SetString(PyExc_ValueError, "faces, twins and lengths need the same number of rows, at most 2^31 / 3");
    } else if (are_twins(x[1].data, half_edges)) {
        Triangulation mesh = {x[0].data, x[1].data, x[2].data, (int32_t)half_edges};
        uint8_t *waiting = malloc((size_t)half_edges + 1);
        int32_t *stack = malloc(((size_t)half_edges + 1) * sizeof *stack);
        if (waiting && stack) {
            int64_t flips;
            Py_BEGIN_ALLOW_THREADS
            flips = flip_to_delaunay(&mesh, waiting, stack);
            Py_END_ALLOW_THREADS
            result = PyLong_FromLongLong(flips);
        } else {
            PyErr_NoMemory();
        }
        free(waiting);
        free(stack);
    }
    arrays_release(&a);
    return result;
}

/* share(twins i(f,3), lengths d(f,3), least) -> (inner edges, those whose cotangents add up to at least `least`) */
static PyObject *count_delaunay(PyObject *self, PyObject *args)
{
    PyObject *o[2], *result = NULL;
    Arrays a;
    double least;
    static const int columns[] = {3, 3};
    static const char *const names[] = {"twins", "lengths"};
    if (!PyArg_ParseTuple(args, "OOd", &o[0], &o[1], &least) || arrays_get(&a, o, "id", columns, names, 0) < 0)
        return NULL;
    Py_ssize_t half_edges = 3 * a.array[0].rows, inner = 0, delaunay = 0;
    Triangulation mesh = {NULL, a.array[0].data, a.array[1].data, (int32_t)half_edges};
    int fits = half_edges <= INT32_MAX && a.array[1].rows == a.array[0].rows;
    for (Py_ssize_t h = 0; fits && h < half_edges; h++)
        fits = mesh.twins[h] >= -1 && mesh.twins[h] < half_edges;
    if (!fits) {
        PyErr_SetString(PyExc_ValueError, "twins: not those of these faces");
    } else {
        for (int32_t h = 0; h < mesh.half_edges; h++)
            if (mesh.twins[h] > h) {
                inner++;
                delaunay += cotangents(half_tangent(&mesh, h), half_tangent(&mesh, mesh.twins[h])) >= least;
            }
        result = Py_BuildValue("nn", inner, delaunay);
    }
    arrays_release(&a);
    return result;
}

static PyMethodDef methods[] = {
    {"measure", measure, METH_VARARGS, "measure(faces, lengths, points)"},
    {"flip", flip_all, METH_VARARGS, "flip(faces, twins, lengths) -> flips"},
    {"count", count_delaunay, METH_VARARGS, "Count inner edges and Delaunay edges."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_delaunay", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__delaunay(void) { return PyModule_Create(&module); }
