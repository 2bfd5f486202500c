/* Python binding of fast winding numbers. Arguments are checked here; the loops in the headers trust them. */
#include "arrays.h"

#include "winding_trace.h"

#define CAPSULE "ndf_core.kernels.WindingTree"

static void capsule_free(PyObject *capsule) { tree_free(PyCapsule_GetPointer(capsule, CAPSULE)); }

static int check_finite(const Array *array, const char *name)
{
    const double *values = array->data;
    for (Py_ssize_t i = 0; i < array->rows * array->columns; i++)
        if (!(fabs(values[i]) < 1e150)) {
            PyErr_Format(PyExc_ValueError, "%s: row %zd is not finite or beyond 1e150", name, i / array->columns);
            return -1;
        }
    return 0;
}

/* Corners in the frame of [-1, 1]^3; NULL without memory. */
static double *scaled(const Array *corners, double *center, double *scale)
{
    const double *from = corners->data;
    const int64_t count = (int64_t)(corners->rows * corners->columns / 3);
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, widest = 0;
    for (int64_t i = 0; i < 3 * count; i++) {
        low[i % 3] = from[i] < low[i % 3] ? from[i] : low[i % 3];
        high[i % 3] = from[i] > high[i % 3] ? from[i] : high[i % 3];
    }
    for (int k = 0; k < 3; k++) {
        center[k] = low[k] + (high[k] - low[k]) / 2;
        widest = high[k] - low[k] > widest ? high[k] - low[k] : widest;
    }
    *scale = widest > 1e-290 ? 2 / widest : 1;
    double *to = malloc((size_t)(3 * count) * sizeof(double));
    if (to)
        for (int64_t i = 0; i < 3 * count; i++) to[i] = (from[i] - center[i % 3]) * *scale;
    return to;
}

static void triangle_areas(const double *corners, int64_t count, double *areas)
{
    for (int64_t i = 0; i < count; i++) {
        const double *p = corners + 9 * i;
        double u[3], v[3];
        for (int k = 0; k < 3; k++) {
            u[k] = p[3 + k] - p[k];
            v[k] = p[6 + k] - p[k];
        }
        areas[3 * i] = (u[1] * v[2] - u[2] * v[1]) / 2;
        areas[3 * i + 1] = (u[2] * v[0] - u[0] * v[2]) / 2;
        areas[3 * i + 2] = (u[0] * v[1] - u[1] * v[0]) / 2;
    }
}

/* `areas` and `radii` are NULL for triangles. */
static Tree *make_tree(const Array *corners, const Array *areas, const Array *radii, double beta)
{
    double center[3], scale;
    int64_t count = corners->rows;
    double *inside = scaled(corners, center, &scale);
    double *vectors = malloc((size_t)(3 * count) * sizeof(double));
    double *balls = radii ? malloc((size_t)count * sizeof(double)) : NULL;
    Tree *tree = NULL;
    if (inside && vectors && (balls || !radii)) {
        if (!radii) triangle_areas(inside, count, vectors);
        for (int64_t i = 0; radii && i < 3 * count; i++) vectors[i] = ((double *)areas->data)[i] * scale * scale;
        /* Balls too small for float32 are made as large as its rounding. */
        for (int64_t i = 0; radii && i < count; i++) {
            double ball = ((double *)radii->data)[i] * scale;
            balls[i] = ball > 1e-6 ? ball : 1e-6;
        }
        tree = tree_build(inside, vectors, balls, count, beta);
    }
    free(inside);
    free(vectors);
    free(balls);
    if (tree) {
        tree->scale = scale;
        memcpy(tree->center, center, sizeof center);
    }
    return tree;
}

static PyObject *build(PyObject *self, PyObject *args)
{
    (void)self;
    PyObject *objects[3], *capsule = NULL;
    double beta;
    if (!PyArg_ParseTuple(args, "OOOd", &objects[0], &objects[1], &objects[2], &beta)) return NULL;
    int triangles = Py_IsNone(objects[1]);
    static const char *const names[] = {"positions", "areas", "radii"};
    const int columns[] = {triangles ? 9 : 3, 3, 1};
    Arrays arrays;
    if (arrays_get(&arrays, objects, triangles ? "d" : "ddd", columns, names, 0) < 0) return NULL;
    int good = 1;
    for (int i = 0; i < arrays.held && good; i++) {
        good = check_finite(&arrays.array[i], names[i]) == 0;
        if (good && arrays.array[i].rows != arrays.array[0].rows) {
            PyErr_Format(PyExc_ValueError, "%s: need %zd rows, got %zd", names[i], arrays.array[0].rows,
                         arrays.array[i].rows);
            good = 0;
        }
    }
    if (good && (arrays.array[0].rows < 1 || arrays.array[0].rows > (1 << 28) || !(beta >= 1))) {
        PyErr_Format(PyExc_ValueError, "need 1 to 2^28 sources and beta of at least 1, got %zd sources",
                     arrays.array[0].rows);
        good = 0;
    }
    if (good) {
        Tree *tree;
        Py_BEGIN_ALLOW_THREADS
        tree = triangles ? make_tree(&arrays.array[0], NULL, NULL, beta)
                         : make_tree(&arrays.array[0], &arrays.array[1], &arrays.array[2], beta);
        Py_END_ALLOW_THREADS
        capsule = tree ? PyCapsule_New(tree, CAPSULE, capsule_free) : PyErr_NoMemory();
        if (tree && !capsule) tree_free(tree);
    }
    arrays_release(&arrays);
    return capsule;
}

static PyObject *evaluate(PyObject *self, PyObject *args)
{
    (void)self;
    PyObject *capsule, *objects[3];
    if (!PyArg_ParseTuple(args, "OOOO", &capsule, &objects[0], &objects[1], &objects[2])) return NULL;
    const Tree *tree = PyCapsule_GetPointer(capsule, CAPSULE);
    int with_gradient = !Py_IsNone(objects[1]);
    PyObject *given[] = {objects[0], with_gradient ? objects[1] : objects[2], objects[2]};
    static const char *const names[] = {"values", "gradients", "queries"};
    static const int columns[] = {1, 3, 3};
    Arrays arrays;
    if (!tree) return NULL;
    if (with_gradient) {
        if (arrays_get(&arrays, given, "ddd", columns, names, 2) < 0) return NULL;
    } else if (arrays_get(&arrays, given, "dd", (const int[]){1, 3}, names, 1) < 0) {
        return NULL;
    }
    const Array *queries = &arrays.array[arrays.held - 1];
    if (queries->rows != arrays.array[0].rows || (with_gradient && queries->rows != arrays.array[1].rows)) {
        PyErr_SetString(PyExc_ValueError, "queries, values and gradients need equally many rows");
        arrays_release(&arrays);
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    winding_rows(tree, queries->data, queries->rows, arrays.array[0].data, with_gradient ? arrays.array[1].data : NULL);
    Py_END_ALLOW_THREADS
    arrays_release(&arrays);
    Py_RETURN_NONE;
}

static PyObject *trace_all(PyObject *self, PyObject *args)
{
    (void)self;
    PyObject *capsule, *objects[6];
    double tolerance;
    if (!PyArg_ParseTuple(args, "OOOOOOOd", &capsule, &objects[0], &objects[1], &objects[2], &objects[3], &objects[4],
                          &objects[5], &tolerance))
        return NULL;
    const Tree *tree = PyCapsule_GetPointer(capsule, CAPSULE);
    static const char *const names[] = {"found", "origins", "directions", "guesses", "steps", "reaches"};
    static const int columns[] = {1, 3, 3, 1, 1, 1};
    Arrays arrays;
    if (!tree || arrays_get(&arrays, objects, "dddddd", columns, names, 1) < 0) return NULL;
    const Array *array = arrays.array;
    for (int i = 1; i < 6; i++)
        if (array[i].rows != array[0].rows) {
            PyErr_Format(PyExc_ValueError, "%s: need %zd rows, got %zd", names[i], array[0].rows, array[i].rows);
            arrays_release(&arrays);
            return NULL;
        }
    Py_BEGIN_ALLOW_THREADS
    Rays rays = {array[1].data, array[2].data, array[3].data, array[4].data, array[5].data};
    trace_rows(tree, &rays, array[0].rows, tolerance, array[0].data);
    Py_END_ALLOW_THREADS
    arrays_release(&arrays);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"build", build, METH_VARARGS, "build(corners (f, 9), None, None, beta) or (points (n, 3), areas, radii, beta)"},
    {"evaluate", evaluate, METH_VARARGS, "evaluate(tree, values, gradients or None, queries)"},
    {"trace", trace_all, METH_VARARGS,
     "trace(tree, found, origins, directions, guesses, steps, reaches, tolerance): distances along the directions"},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_winding", NULL, -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__winding(void) { return PyModule_Create(&module); }
