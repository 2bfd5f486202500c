/* Facts about a triangle mesh, each in linear time: twins of half-edges, manifoldness, Delaunay edges, folds. */
#include "arrays.h"
#include <math.h>
#include <stdlib.h>

#define NEXT(i) ((i) == 2 ? 0 : (i) + 1)
#define BOUNDARY -1
#define SINGULAR -2 /* an edge of more than two faces, or of two that run through it in the same direction */

/* Order half-edges by vertex `key` (of the pair's larger, then smaller one), keeping the order among equals. */
static void counting_sort(const int32_t *order, int32_t *sorted, const int32_t *key, Py_ssize_t count,
                          Py_ssize_t *starts, Py_ssize_t vertices)
{
    memset(starts, 0, sizeof *starts * (size_t)(vertices + 1));
    for (Py_ssize_t i = 0; i < count; i++)
        starts[key[i] + 1]++;
    for (Py_ssize_t v = 0; v < vertices; v++)
        starts[v + 1] += starts[v];
    for (Py_ssize_t i = 0; i < count; i++) {
        int32_t h = order ? order[i] : (int32_t)i;
        sorted[starts[key[h]]++] = h;
    }
}

typedef struct {
    Py_ssize_t edges, boundary, crowded, inconsistent; /* edges; of one face; of more than two; of wrong direction */
} EdgeCounts;

/* Fill `twins`; `low`, `high` and the two orders are scratch of one entry per half-edge, `starts` one per vertex + 1. */
static EdgeCounts link_edges(const int32_t *corners, Py_ssize_t faces, Py_ssize_t vertices, int32_t *twins,
                             int32_t *scratch, Py_ssize_t *starts)
{
    Py_ssize_t count = 3 * faces;
    int32_t *low = scratch, *high = low + count, *by_high = high + count, *order = by_high + count;
    for (Py_ssize_t h = 0; h < count; h++) {
        int32_t a = corners[h], b = corners[h - h % 3 + NEXT(h % 3)];
        low[h] = a < b ? a : b;
        high[h] = a < b ? b : a;
    }
    counting_sort(NULL, by_high, high, count, starts, vertices);
    counting_sort(by_high, order, low, count, starts, vertices);
    EdgeCounts counts = {0, 0, 0, 0};
    for (Py_ssize_t i = 0, end; i < count; i = end) {
        int32_t h = order[i], g = i + 1 < count ? order[i + 1] : h;
        for (end = i + 1; end < count && low[order[end]] == low[h] && high[order[end]] == high[h];)
            end++;
        counts.edges++;
        if (end - i == 2 && corners[h] != corners[g]) {
            twins[h] = g;
            twins[g] = h;
            continue;
        }
        counts.boundary += end - i == 1;
        counts.crowded += end - i > 2;
        counts.inconsistent += end - i == 2;
        for (Py_ssize_t k = i; k < end; k++)
            twins[order[k]] = end - i == 1 ? BOUNDARY : SINGULAR;
    }
    return counts;
}

/* Faces around a vertex form fans, joined across twins. Returns the number of vertices with more than one; `used` is
 * the number of vertices with any. `fans` has a byte per vertex, `seen` one per half-edge. */
static Py_ssize_t count_singular_vertices(const int32_t *corners, const int32_t *twins, Py_ssize_t faces,
                                          Py_ssize_t vertices, uint8_t *fans, uint8_t *seen, Py_ssize_t *used)
{
    Py_ssize_t singular = 0;
    memset(fans, 0, (size_t)vertices);
    memset(seen, 0, (size_t)(3 * faces));
    for (Py_ssize_t start = 0; start < 3 * faces; start++) {
        if (seen[start])
            continue;
        if (fans[corners[start]] < 2)
            fans[corners[start]]++;
        for (Py_ssize_t h = start; h >= 0 && !seen[h]; h = twins[h - h % 3 + (h % 3 + 2) % 3])
            seen[h] = 1; /* the next outgoing half-edge is the twin of the incoming one */
        for (Py_ssize_t g = twins[start]; g >= 0;) {
            Py_ssize_t h = g - g % 3 + NEXT(g % 3);
            if (seen[h])
                break;
            seen[h] = 1;
            g = twins[h];
        }
    }
    *used = 0;
    for (Py_ssize_t v = 0; v < vertices; v++) {
        singular += fans[v] > 1;
        *used += fans[v] > 0;
    }
    return singular;
}

typedef struct {
    double normal[3], area; /* area vector and its length: twice the area */
} Face;

static void face_fill(Face *face, const double *points, const int32_t *corner)
{
    const double *p = points + 3 * (Py_ssize_t)corner[0], *q = points + 3 * (Py_ssize_t)corner[1];
    const double *r = points + 3 * (Py_ssize_t)corner[2];
    double u[3], v[3];
    for (int k = 0; k < 3; k++) {
        u[k] = q[k] - p[k];
        v[k] = r[k] - p[k];
    }
    for (int k = 0; k < 3; k++)
        face->normal[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
    face->area = sqrt(face->normal[0] * face->normal[0] + face->normal[1] * face->normal[1]
                      + face->normal[2] * face->normal[2]);
}

/* Cotangent of the angle opposite half-edge h. A triangle without area counts as the limit of thin ones. */
static double cotangent(const double *points, const int32_t *corners, Py_ssize_t h, double area)
{
    Py_ssize_t first = h - h % 3;
    const double *a = points + 3 * (Py_ssize_t)corners[h], *b = points + 3 * (Py_ssize_t)corners[first + NEXT(h % 3)];
    const double *o = points + 3 * (Py_ssize_t)corners[first + (h % 3 + 2) % 3];
    double product = 0.0;
    for (int k = 0; k < 3; k++)
        product += (a[k] - o[k]) * (b[k] - o[k]);
    if (area > 0)
        return product / area;
    return product < 0 ? -1e300 : 1e300;
}

typedef struct {
    Py_ssize_t inner, delaunay;
    double area, folded;
} Shape;

/* Inner edges, those whose opposite cotangents add up to -1e-6 at least; area, and area of faces beside which another
 * lies folded over (unit normals' product below -1/2). */
static Shape measure_shape(const double *points, const int32_t *corners, const int32_t *twins, Py_ssize_t faces,
                           Face *face)
{
    Shape shape = {0, 0, 0.0, 0.0};
    for (Py_ssize_t f = 0; f < faces; f++)
        face_fill(&face[f], points, corners + 3 * f);
    for (Py_ssize_t f = 0; f < faces; f++) {
        int folded = 0;
        for (Py_ssize_t h = 3 * f; h < 3 * f + 3; h++) {
            if (twins[h] < 0)
                continue;
            const Face *mine = &face[f], *other = &face[twins[h] / 3];
            double product = mine->normal[0] * other->normal[0] + mine->normal[1] * other->normal[1]
                           + mine->normal[2] * other->normal[2];
            folded |= product < -0.5 * mine->area * other->area;
            if (twins[h] > h) {
                double sum = cotangent(points, corners, h, mine->area) + cotangent(points, corners, twins[h], other->area);
                shape.inner++;
                shape.delaunay += sum >= -1e-6;
            }
        }
        shape.area += 0.5 * face[f].area;
        shape.folded += folded ? 0.5 * face[f].area : 0.0;
    }
    return shape;
}

static int corners_in_range(const int32_t *corners, Py_ssize_t count, Py_ssize_t vertices)
{
    for (Py_ssize_t h = 0; h < count; h++)
        if (corners[h] < 0 || corners[h] >= vertices) {
            PyErr_Format(PyExc_IndexError, "faces: index %d is outside [0, %zd)", corners[h], vertices);
            return 0;
        }
    return 1;
}

/* check(twins i(f,3), faces i(f,3), vertex_count) ->
 *     (edges, boundary, crowded, inconsistent, singular vertices, used vertices, degenerate faces) */
static PyObject *check(PyObject *self, PyObject *args)
{
    PyObject *objects[2], *result = NULL;
    Py_ssize_t vertices, used = 0, singular = 0, degenerate = 0;
    Array twins, corners;
    EdgeCounts counts = {0, 0, 0, 0};
    if (!PyArg_ParseTuple(args, "OOn", &objects[0], &objects[1], &vertices)
        || array_get(objects[0], &twins, 'i', 3, 1, "twins") < 0)
        return NULL;
    if (array_get(objects[1], &corners, 'i', 3, 0, "faces") < 0) {
        array_release(&twins);
        return NULL;
    }
    Py_ssize_t faces = corners.rows;
    if (vertices < 0 || vertices > INT32_MAX || faces > INT32_MAX / 3 || twins.rows != faces) {
        PyErr_SetString(PyExc_ValueError, "twins and faces need the same number of rows; counts must fit 32 bits");
    } else if (corners_in_range(corners.data, 3 * faces, vertices)) {
        int32_t *scratch = malloc(sizeof *scratch * (size_t)(12 * faces + 1));
        Py_ssize_t *starts = malloc(sizeof *starts * (size_t)(vertices + 1));
        if (scratch && starts) {
            Py_BEGIN_ALLOW_THREADS
            const int32_t *corner = corners.data;
            for (Py_ssize_t f = 0; f < faces; f++, corner += 3)
                degenerate += corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0];
            counts = link_edges(corners.data, faces, vertices, twins.data, scratch, starts);
            singular = count_singular_vertices(corners.data, twins.data, faces, vertices, (uint8_t *)starts,
                                               (uint8_t *)scratch, &used);
            Py_END_ALLOW_THREADS
            result = Py_BuildValue("nnnnnnn", counts.edges, counts.boundary, counts.crowded, counts.inconsistent,
                                   singular, used, degenerate);
        } else {
            PyErr_NoMemory();
        }
        free(scratch);
        free(starts);
    }
    array_release(&twins);
    array_release(&corners);
    return result;
}

/* shape(points d(n,3), faces i(f,3), twins i(f,3)) -> (inner edges, Delaunay edges, area, folded area) */
static PyObject *shape(PyObject *self, PyObject *args)
{
    PyObject *objects[3], *result = NULL;
    Array arrays[3];
    static const char *const names[] = {"points", "faces", "twins"};
    int held = 0;
    if (!PyArg_ParseTuple(args, "OOO", &objects[0], &objects[1], &objects[2]))
        return NULL;
    for (; held < 3; held++)
        if (array_get(objects[held], &arrays[held], held ? 'i' : 'd', 3, 0, names[held]) < 0)
            goto done;
    Py_ssize_t faces = arrays[1].rows;
    const int32_t *twins = arrays[2].data;
    if (!corners_in_range(arrays[1].data, 3 * faces, arrays[0].rows))
        goto done;
    int fits = arrays[2].rows == faces;
    for (Py_ssize_t h = 0; fits && h < 3 * faces; h++)
        fits = twins[h] < 3 * faces;
    if (!fits) {
        PyErr_SetString(PyExc_ValueError, "twins: not those of these faces");
        goto done;
    }
    Face *face = malloc(sizeof *face * (size_t)(faces + 1));
    if (!face) {
        PyErr_NoMemory();
        goto done;
    }
    Shape found;
    Py_BEGIN_ALLOW_THREADS
    found = measure_shape(arrays[0].data, arrays[1].data, twins, faces, face);
    Py_END_ALLOW_THREADS
    free(face);
    result = Py_BuildValue("nndd", found.inner, found.delaunay, found.area, found.folded);
done:
    while (held--)
        array_release(&arrays[held]);
    return result;
}

static PyMethodDef methods[] = {
    {"check", check, METH_VARARGS, "Link half-edges and count what is not manifold."},
    {"shape", shape, METH_VARARGS, "Measure Delaunay edges and folds."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_mesh_check", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__mesh_check(void) { return PyModule_Create(&module); }
