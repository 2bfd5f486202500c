/* First variation of geodesic distances: what they change by when the lengths of the edges change a little.
 *
 * A shortest path stays the shortest but for second order, so its length under the new lengths is enough. Paths are not
 * followed one by one: at a vertex, the path that arrives there crosses the opposite edge of one of its faces, where the
 * change is known from the two ends, which are nearer to the source.
 */
#include "arrays.h"
#include <math.h>
#include <stdlib.h>

typedef struct {
    int32_t faces, vertices;
    const int32_t *corners;
    const double *before, *after; /* lengths by half-edge */
    const double *distances;
    double *shifts; /* NAN where not known yet */
    int32_t *starts, *around; /* half-edges that leave each vertex */
} Variation;

static inline int32_t next(int32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
static inline int32_t previous(int32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

static void find_around(const Variation *problem)
{
    int32_t *starts = problem->starts;
    for (int32_t v = 0; v <= problem->vertices; v++) starts[v] = 0;
    for (int32_t h = 0; h < 3 * problem->faces; h++) starts[problem->corners[h] + 1]++;
    for (int32_t v = 0; v < problem->vertices; v++) starts[v + 1] += starts[v];
    for (int32_t h = 3 * problem->faces - 1; h >= 0; h--) problem->around[--starts[problem->corners[h] + 1]] = h;
    for (int32_t v = 0; v < problem->vertices; v++) starts[v] = starts[v + 1];
    starts[problem->vertices] = 3 * problem->faces;
}

/* Length from the start of h to the point of the opposite edge at `share` of the way (Stewart's theorem). */
static double across(const double *lengths, int32_t h, double share)
{
    double a = lengths[h], b = lengths[previous(h)], c = lengths[next(h)];
    return sqrt(fmax((1 - share) * a * a + share * b * b - share * (1 - share) * c * c, 0));
}

/* Where the path that arrives at the start of h through its face crosses the opposite edge, as a share of the way along
 * that; -1 if it comes through another face. Distances are taken as linear in the face. */
static double crossing(const Variation *problem, int32_t h)
{
    double a = problem->before[h], b = problem->before[previous(h)], c = problem->before[next(h)];
    double here = problem->distances[problem->corners[h]];
    double fall = here - problem->distances[problem->corners[next(h)]];
    double other = here - problem->distances[problem->corners[previous(h)]];
    double product = 0.5 * (a * a + b * b - c * c); /* inner product of the sides a and b */
    /* Minus the gradient is p a + q b with the Gram matrix of the sides times (p, q) = (fall, other). */
    double p = b * b * fall - product * other, q = a * a * other - product * fall;
    return p >= 0 && q >= 0 && p + q > 0 ? q / (p + q) : -1;
}

/* The change at a vertex whose nearer neighbours are done: through the face, or along the edge, with the least detour.
 * Detours come from distances not being linear along edges; their share of the change is taken off. */
static double shift_at(const Variation *problem, int32_t v)
{
    double best = INFINITY, shift = 0;
    for (int32_t i = problem->starts[v]; i < problem->starts[v + 1]; i++) {
        int32_t h = problem->around[i], end = problem->corners[next(h)], other = problem->corners[previous(h)];
        double share = crossing(problem, h), near = problem->shifts[end], far = problem->shifts[other];
        if (share >= 0 && !isnan(near) && !isnan(far)) {
            double inside = across(problem->before, h, share);
            double length = (1 - share) * problem->distances[end] + share * problem->distances[other] + inside;
            if (length < best) {
                best = length;
                shift = (1 - share) * near + share * far + across(problem->after, h, share) - inside;
            }
        }
        const int32_t sides[2] = {h, previous(h)}, ends[2] = {end, other};
        for (int k = 0; k < 2; k++) {
            if (isnan(problem->shifts[ends[k]])) continue;
            double length = problem->distances[ends[k]] + problem->before[sides[k]];
            if (!(length < best)) continue;
            best = length;
            shift = problem->shifts[ends[k]] + problem->after[sides[k]] - problem->before[sides[k]];
        }
    }
    return best > 0 && best < INFINITY ? shift * (problem->distances[v] / best) : shift;
}

static int are_below(const Array *indices, Py_ssize_t limit, const char *name)
{
    const int32_t *index = indices->data;
    for (Py_ssize_t i = 0; i < indices->rows * indices->columns; i++)
        if (index[i] < 0 || index[i] >= limit) {
            PyErr_Format(PyExc_IndexError, "%s: index %d is outside [0, %zd)", name, index[i], limit);
            return 0;
        }
    return 1;
}

static int is_problem(const Array *x)
{
    Py_ssize_t vertices = x[0].rows, faces = x[1].rows;
    if (3 * faces > INT32_MAX || x[2].rows != faces || x[3].rows != faces || x[4].rows != vertices) {
        PyErr_SetString(PyExc_ValueError, "need two lengths per side, and a distance and a shift per vertex");
        return 0;
    }
    return are_below(&x[1], vertices, "faces") && are_below(&x[5], vertices, "order");
}

/* spread(shifts d(v,), faces i(f,3), before d(f,3), after d(f,3), distances d(v,), order i(n,)) */
static PyObject *spread(PyObject *self, PyObject *args)
{
    PyObject *o[6], *result = NULL;
    Arrays a;
    static const int columns[] = {1, 3, 3, 3, 1, 1};
    static const char *const names[] = {"shifts", "faces", "before", "after", "distances", "order"};
    if (!PyArg_ParseTuple(args, "OOOOOO", &o[0], &o[1], &o[2], &o[3], &o[4], &o[5])
        || arrays_get(&a, o, "didddi", columns, names, 1) < 0)
        return NULL;
    Array *x = a.array;
    Variation problem = {(int32_t)x[1].rows, (int32_t)x[0].rows, x[1].data, x[2].data, x[3].data, x[4].data, x[0].data,
                         malloc(((size_t)x[0].rows + 2) * sizeof(int32_t)),
                         malloc((3 * (size_t)x[1].rows + 1) * sizeof(int32_t))};
    if (!problem.starts || !problem.around) {
        PyErr_NoMemory();
    } else if (is_problem(x)) {
        const int32_t *order = x[5].data;
        Py_BEGIN_ALLOW_THREADS
        find_around(&problem);
        for (Py_ssize_t i = 0; i < x[5].rows; i++)
            if (isnan(problem.shifts[order[i]])) problem.shifts[order[i]] = shift_at(&problem, order[i]);
        Py_END_ALLOW_THREADS
        result = Py_NewRef(Py_None);
    }
    free(problem.starts);
    free(problem.around);
    arrays_release(&a);
    return result;
}

static PyMethodDef methods[] = {
    {"spread", spread, METH_VARARGS, "spread(shifts, faces, before, after, distances, order)"},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_variation", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__variation(void) { return PyModule_Create(&module); }
