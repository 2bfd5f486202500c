/* Python binding of the triangle BVH. Arguments are checked here; the loops in the headers trust them. */
#include "arrays.h"

#include "bvh_closest.h"
#include "bvh_overlap.h"
#include "bvh_ray.h"

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

/* Buffers of one call: `count` arrays of equally many rows, of which the first `inputs` are read-only and finite. */
static int get_rows(PyObject **objects, Array *arrays, int count, int inputs, const char *formats,
                    const Py_ssize_t *columns, const char **names)
{
    int held = 0;
    while (held < count &&
           array_get(objects[held], &arrays[held], formats[held], columns[held], held >= inputs, names[held]) == 0)
        held++;
    int good = held == count;
    for (int i = 0; good && i < count; i++) {
        if (arrays[i].rows != arrays[0].rows) {
            PyErr_Format(PyExc_ValueError, "%s: need %zd rows like %s, got %zd", names[i], arrays[0].rows, names[0],
                         arrays[i].rows);
            good = 0;
        }
        good = good && (i >= inputs || check_values(&arrays[i], DBL_MAX, names[i]) == 0);
    }
    while (!good && held > 0) array_release(&arrays[--held]);
    return good ? 0 : -1;
}

static PyObject *closest(PyObject *self, PyObject *args)
{
    (void)self;
    static const Py_ssize_t columns[] = {3, 3, 1, 3};
    static const char *names[] = {"queries", "points", "faces", "barycentric"};
    PyObject *capsule, *objects[4];
    Array arrays[4];
    if (!PyArg_ParseTuple(args, "OOOOO", &capsule, &objects[0], &objects[1], &objects[2], &objects[3])) return NULL;
    const Tree *tree = PyCapsule_GetPointer(capsule, CAPSULE);
    if (!tree || get_rows(objects, arrays, 4, 1, "ddid", columns, names) < 0) return NULL;
    int status;
    Py_BEGIN_ALLOW_THREADS
    status = closest_sorted(tree, arrays[0].data, arrays[0].rows, arrays[1].data, arrays[2].data, arrays[3].data);
    Py_END_ALLOW_THREADS
    for (int i = 0; i < 4; i++) array_release(&arrays[i]);
    return status == 0 ? Py_NewRef(Py_None) : PyErr_NoMemory();
}

static PyObject *first_hit(PyObject *self, PyObject *args)
{
    (void)self;
    static const Py_ssize_t columns[] = {3, 3, 1, 1};
    static const char *names[] = {"origins", "directions", "t", "faces"};
    PyObject *capsule, *objects[4];
    Array arrays[4];
    if (!PyArg_ParseTuple(args, "OOOOO", &capsule, &objects[0], &objects[1], &objects[2], &objects[3])) return NULL;
    const Tree *tree = PyCapsule_GetPointer(capsule, CAPSULE);
    if (!tree || get_rows(objects, arrays, 4, 2, "dddi", columns, names) < 0) return NULL;
    const double *d = arrays[1].data;
    Py_ssize_t rows = arrays[0].rows, row = 0;
    while (row < rows && (d[3 * row] != 0.0 || d[3 * row + 1] != 0.0 || d[3 * row + 2] != 0.0)) row++;
    if (row == rows) {
        Py_BEGIN_ALLOW_THREADS
        first_hit_rows(tree, arrays[0].data, d, rows, arrays[2].data, arrays[3].data);
        Py_END_ALLOW_THREADS
    } else {
        PyErr_Format(PyExc_ValueError, "directions: row %zd is zero", row);
    }
    for (int i = 0; i < 4; i++) array_release(&arrays[i]);
    return row == rows ? Py_NewRef(Py_None) : NULL;
}

static PyObject *self_intersections(PyObject *self, PyObject *args)
{
    (void)self;
    PyObject *capsule;
    long long limit;
    int part, parts;
    if (!PyArg_ParseTuple(args, "OLii", &capsule, &limit, &part, &parts)) return NULL;
    const Tree *tree = PyCapsule_GetPointer(capsule, CAPSULE);
    if (!tree) return NULL;
    if (part < 0 || part >= parts) return PyErr_Format(PyExc_ValueError, "there is no part %d of %d", part, parts);
    PairList list = {.limit = limit};
    Py_BEGIN_ALLOW_THREADS
    find_pairs(tree, tree->node_count * part / parts, tree->node_count * (part + 1) / parts, &list);
    Py_END_ALLOW_THREADS
    PyObject *result = list.failed ? PyErr_NoMemory()
                                   : PyByteArray_FromStringAndSize((const char *)list.pairs,
                                                                   (Py_ssize_t)(list.count * 2 * sizeof(int32_t)));
    free(list.pairs);
    return result;
}

static PyMethodDef methods[] = {
    {"build", build, METH_VARARGS, "build(vertices, faces) -> capsule"},
    {"closest", closest, METH_VARARGS, "closest(tree, queries, points, faces, barycentric)"},
    {"first_hit", first_hit, METH_VARARGS, "first_hit(tree, origins, directions, t, faces)"},
    {"self_intersections", self_intersections, METH_VARARGS, "self_intersections(tree, limit, part, parts) -> bytearray of int32"},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_bvh", NULL, -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__bvh(void) { return PyModule_Create(&module); }
