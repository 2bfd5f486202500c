/* Python binding of the triangle BVH. Arguments are checked here; the loops in the headers trust them. */
#include "arrays.h"

#include "bvh_closest.h"

#define CAPSULE "ndf_core.kernels.TriangleBVH"
#define CHUNK 262144 /* rows sorted together: bounds the scratch memory */

static void capsule_free(PyObject *capsule) { tree_free(PyCapsule_GetPointer(capsule, CAPSULE)); }

/* `largest` bounds the magnitude: extents of vertices must not overflow. Fails for NaN too. */
static int check_values(const Array *array, double largest, const char *name)
{
    const double *values = array->data;
    for (Py_ssize_t i = 0; i < array->rows * array->columns; i++)
        if (!(fabs(values[i]) <= largest)) {
            PyErr_Format(PyExc_ValueError, "%s: row %zd is not finite%s", name, i / array->columns,
                         largest < DBL_MAX ? " or beyond 1e150" : "");
            return -1;
        }
    return 0;
}

static int check_faces(const Array *faces, Py_ssize_t vertex_count)
{
    const int32_t *corners = faces->data;
    if (faces->rows < 1 || faces->rows > (1 << 28) || vertex_count > INT32_MAX) {
        PyErr_Format(PyExc_ValueError, "faces: need 1 to 2^28 faces over at most 2^31 - 1 vertices, got %zd over %zd",
                     faces->rows, vertex_count);
        return -1;
    }
    for (Py_ssize_t i = 0; i < 3 * faces->rows; i++)
        if (corners[i] < 0 || corners[i] >= vertex_count) {
            PyErr_Format(PyExc_ValueError, "faces: row %zd names vertex %d of %zd", i / 3, (int)corners[i],
                         vertex_count);
            return -1;
        }
    return 0;
}

static PyObject *build(PyObject *self, PyObject *args)
{
    (void)self;
    PyObject *vertices_object, *faces_object, *capsule = NULL;
    Array vertices, faces;
    if (!PyArg_ParseTuple(args, "OO", &vertices_object, &faces_object)) return NULL;
    if (array_get(vertices_object, &vertices, 'd', 3, 0, "vertices") < 0) return NULL;
    if (array_get(faces_object, &faces, 'i', 3, 0, "faces") < 0) {
        array_release(&vertices);
        return NULL;
    }
    if (check_values(&vertices, 1e150, "vertices") == 0 && check_faces(&faces, vertices.rows) == 0) {
        Tree *tree;
        Py_BEGIN_ALLOW_THREADS
        tree = tree_build(vertices.data, vertices.rows, faces.data, faces.rows);
        Py_END_ALLOW_THREADS
        capsule = tree ? PyCapsule_New(tree, CAPSULE, capsule_free) : PyErr_NoMemory();
        if (tree && !capsule) tree_free(tree);
    }
    array_release(&vertices);
    array_release(&faces);
    return capsule;
}

static int closest_sorted(const Tree *tree, const double *queries, int64_t count, double *points, int32_t *faces,
                          double *weights)
{
    int64_t chunk = count < CHUNK ? count : CHUNK;
    uint32_t *scratch = malloc((size_t)(4 * chunk + 1) * sizeof(uint32_t));
    if (!scratch) return -1;
    int32_t *order = (int32_t *)(scratch + 3 * chunk);
    for (int64_t start = 0; start < count; start += chunk) {
        int64_t size = count - start < chunk ? count - start : chunk;
        morton_order(queries + 3 * start, size, order, scratch);
        closest_rows(tree, queries + 3 * start, order, size, points + 3 * start, faces + start, weights + 3 * start);
    }
    free(scratch);
    return 0;
}

static PyObject *closest(PyObject *self, PyObject *args)
{
    (void)self;
    PyObject *objects[4], *capsule, *result = NULL;
    Array arrays[4];
    static const char formats[] = "ddid";
    static const Py_ssize_t columns[] = {3, 3, 1, 3};
    static const char *names[] = {"queries", "points", "faces", "barycentric"};
    if (!PyArg_ParseTuple(args, "OOOOO", &capsule, &objects[0], &objects[1], &objects[2], &objects[3])) return NULL;
    const Tree *tree = PyCapsule_GetPointer(capsule, CAPSULE);
    if (!tree) return NULL;
    int held = 0;
    while (held < 4 && array_get(objects[held], &arrays[held], formats[held], columns[held], held > 0, names[held]) == 0)
        held++;
    if (held == 4) {
        Py_ssize_t rows = arrays[0].rows;
        if (arrays[1].rows != rows || arrays[2].rows != rows || arrays[3].rows != rows) {
            PyErr_SetString(PyExc_ValueError, "closest: the answers need as many rows as the queries");
        } else if (check_values(&arrays[0], DBL_MAX, "queries") == 0) {
            int status;
            Py_BEGIN_ALLOW_THREADS
            status = closest_sorted(tree, arrays[0].data, rows, arrays[1].data, arrays[2].data, arrays[3].data);
            Py_END_ALLOW_THREADS
            result = status == 0 ? Py_NewRef(Py_None) : PyErr_NoMemory();
        }
    }
    while (held > 0) array_release(&arrays[--held]);
    return result;
}

static PyMethodDef methods[] = {
    {"build", build, METH_VARARGS, "build(vertices, faces) -> capsule"},
    {"closest", closest, METH_VARARGS, "closest(tree, queries, points, faces, barycentric)"},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_bvh", NULL, -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__bvh(void) { return PyModule_Create(&module); }
