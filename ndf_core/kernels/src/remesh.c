/* Python binding of remeshing. The state is a capsule; sizes are checked here, and the passes trust them. */
#include "arrays.h"

#include "measuring.h"
#include "moving.h"
#include "splitting.h"

#define CAPSULE "ndf_core.kernels.Remesh"

typedef struct {
    int32_t *corners, *twins; /* of the base mesh */
    Surface surface;
    Triangulation mesh;
    Places places;
} State;

static void state_free(State *state)
{
    free(state->corners);
    free(state->twins);
    surface_free(&state->surface);
    triangulation_free(&state->mesh);
    free(state->places.item);
    free(state->places.point);
    free(state->places.shift);
    free(state);
}

static void capsule_free(PyObject *capsule) { state_free(PyCapsule_GetPointer(capsule, CAPSULE)); }

static State *state_of(PyObject *capsule) { return PyCapsule_GetPointer(capsule, CAPSULE); }

/* Whether every face names three vertices, every vertex is named, and twins are the other sides of the same edges. */
static int is_mesh(const int32_t *corners, const int32_t *twins, int32_t half_edges, Py_ssize_t vertices)
{
    uint8_t *named = calloc((size_t)vertices + 1, 1);
    int good = named != NULL;
    for (int32_t h = 0; good && h < half_edges; h++) {
        int32_t a = corners[h], b = corners[next(h)], g = twins[h];
        good = a >= 0 && a < vertices && b >= 0 && b < vertices && a != b && g >= -1 && g < half_edges;
        if (good && g >= 0) good = g != h && twins[g] == h && corners[g] == b && corners[next(g)] == a;
        if (good) named[a] = 1;
    }
    for (Py_ssize_t v = 0; good && v < vertices; v++) good = named[v];
    free(named);
    return good;
}

static State *state_create(const Array *positions, const Array *corners, const Array *twins, const Array *mapped)
{
    size_t size = 3 * (size_t)corners->rows * sizeof(int32_t);
    State *state = calloc(1, sizeof *state);
    if (!state) return NULL;
    state->corners = malloc(size + 1);
    state->twins = malloc(size + 1);
    int result = -2;
    if (state->corners && state->twins) {
        memcpy(state->corners, corners->data, size);
        memcpy(state->twins, twins->data, size);
        result = surface_create(&state->surface, state->corners, state->twins, (int32_t)corners->rows, positions->data);
    }
    if (result == 0 && !triangulation_create(&state->mesh, &state->surface, (int32_t)positions->rows)) result = -2;
    if (result == 0) memcpy(state->mesh.mapped, mapped->data, 3 * sizeof(double) * (size_t)positions->rows);
    if (result == 0) return state;
    state_free(state);
    return NULL;
}

/* create(positions d(v,3), faces i(f,3), twins i(f,3), mapped d(v,3)) -> capsule */
static PyObject *create(PyObject *self, PyObject *args)
{
    PyObject *o[4], *capsule = NULL;
    Arrays a;
    static const int columns[] = {3, 3, 3, 3};
    static const char *const names[] = {"positions", "faces", "twins", "mapped"};
    if (!PyArg_ParseTuple(args, "OOOO", &o[0], &o[1], &o[2], &o[3]) || arrays_get(&a, o, "diid", columns, names, 0) < 0)
        return NULL;
    Array *x = a.array;
    if (x[1].rows > 1 << 28 || x[0].rows > 1 << 28 || x[2].rows != x[1].rows || x[3].rows != x[0].rows
        || !is_mesh(x[1].data, x[2].data, (int32_t)(3 * x[1].rows), x[0].rows)) {
        PyErr_SetString(PyExc_ValueError, "faces, twins: need those of an oriented manifold that uses all positions");
    } else {
        State *state = state_create(&x[0], &x[1], &x[2], &x[3]);
        capsule = state ? PyCapsule_New(state, CAPSULE, capsule_free) : PyErr_NoMemory();
        if (state && !capsule) state_free(state);
    }
    arrays_release(&a);
    return capsule;
}

/* size(state) -> (vertices, faces) */
static PyObject *size(PyObject *self, PyObject *capsule)
{
    State *state = state_of(capsule);
    return state ? Py_BuildValue("ii", state->mesh.used_vertices, state->mesh.used_faces) : NULL;
}

/* measure(state) -> (area, longest edge) of the mapped mesh */
static PyObject *measure(PyObject *self, PyObject *capsule)
{
    State *state = state_of(capsule);
    double area = 0, longest = 0;
    if (!state) return NULL;
    Py_BEGIN_ALLOW_THREADS
    measure_mapped(&state->mesh, &area, &longest);
    Py_END_ALLOW_THREADS
    return Py_BuildValue("dd", area, longest);
}

/* find_long(state, limit, along) -> (places, refused) */
static PyObject *find_long(PyObject *self, PyObject *args)
{
    PyObject *capsule;
    double limit;
    int along, done;
    State *state;
    if (!PyArg_ParseTuple(args, "Odp", &capsule, &limit, &along) || !(state = state_of(capsule))) return NULL;
    int32_t refused = 0;
    Py_BEGIN_ALLOW_THREADS
    done = find_long_edges(&state->mesh, limit, along, &state->places, &refused);
    Py_END_ALLOW_THREADS
    return done ? Py_BuildValue("ii", state->places.count, refused) : PyErr_NoMemory();
}

/* find_folded(state) -> places */
static PyObject *find_folded(PyObject *self, PyObject *capsule)
{
    int done;
    State *state = state_of(capsule);
    if (!state) return NULL;
    Py_BEGIN_ALLOW_THREADS
    done = find_folded_edges(&state->mesh, &state->places);
    Py_END_ALLOW_THREADS
    return done ? PyLong_FromLong(state->places.count) : PyErr_NoMemory();
}

/* find_moves(state, folded, limit) -> places */
static PyObject *find_shifts(PyObject *self, PyObject *args)
{
    PyObject *capsule;
    int folded, done;
    double limit, tolerance;
    State *state;
    if (!PyArg_ParseTuple(args, "Opdd", &capsule, &folded, &limit, &tolerance) || !(state = state_of(capsule))) return NULL;
    Py_BEGIN_ALLOW_THREADS
    done = find_moves(&state->mesh, folded, limit, tolerance, &state->places);
    Py_END_ALLOW_THREADS
    return done ? PyLong_FromLong(state->places.count) : PyErr_NoMemory();
}

/* places(state, faces i(n,), weights d(n,3)): the places that were found last */
static PyObject *places(PyObject *self, PyObject *args)
{
    PyObject *capsule, *o[2];
    Arrays a;
    static const int columns[] = {1, 3};
    static const char *const names[] = {"faces", "weights"};
    if (!PyArg_ParseTuple(args, "OOO", &capsule, &o[0], &o[1]) || !state_of(capsule)
        || arrays_get(&a, o, "id", columns, names, 2) < 0)
        return NULL;
    const Places *found = &state_of(capsule)->places;
    int fits = a.array[0].rows == found->count && a.array[1].rows == found->count;
    int32_t *faces = a.array[0].data;
    double *weights = a.array[1].data;
    for (int32_t i = 0; fits && i < found->count; i++) {
        faces[i] = found->point[i].face;
        memcpy(weights + 3 * (size_t)i, found->point[i].weight, sizeof found->point[i].weight);
    }
    arrays_release(&a);
    return fits ? Py_NewRef(Py_None) : PyErr_Format(PyExc_ValueError, "faces, weights: need %d rows", found->count);
}

typedef int64_t (*Apply)(Triangulation *mesh, Places *places, const double *mapped);

/* Run a pass over the places found last: `mapped` d(n,3) is where the map takes them. Returns what it counts. */
static PyObject *apply(PyObject *args, Apply pass)
{
    PyObject *capsule, *object;
    Array mapped;
    State *state;
    if (!PyArg_ParseTuple(args, "OO", &capsule, &object) || !(state = state_of(capsule))
        || array_get(object, &mapped, 'd', 3, 0, "mapped") < 0)
        return NULL;
    int64_t result = -1;
    if (mapped.rows != state->places.count) {
        PyErr_Format(PyExc_ValueError, "mapped: need %d rows, got %zd", state->places.count, mapped.rows);
    } else {
        Py_BEGIN_ALLOW_THREADS
        result = pass(&state->mesh, &state->places, mapped.data);
        Py_END_ALLOW_THREADS
        if (result < 0) PyErr_NoMemory();
    }
    array_release(&mapped);
    return result < 0 ? NULL : Py_BuildValue("Li", (long long)result, state->places.count);
}

/* split(state, mapped) -> (refused, 0); flip_held(state, mapped) -> (flips, places); move(state, mapped) -> (moves, 0) */
static PyObject *split(PyObject *self, PyObject *args) { return apply(args, split_long_edges); }
static PyObject *flip_held(PyObject *self, PyObject *args) { return apply(args, flip_held_edges); }
static PyObject *move(PyObject *self, PyObject *args) { return apply(args, move_vertices); }

/* remove_short(state, limit) -> removed vertices */
static PyObject *remove_short(PyObject *self, PyObject *args)
{
    PyObject *capsule;
    double limit;
    State *state;
    if (!PyArg_ParseTuple(args, "Od", &capsule, &limit) || !(state = state_of(capsule))) return NULL;
    int32_t removed;
    state->places.count = 0;
    Py_BEGIN_ALLOW_THREADS
    removed = remove_short_edges(&state->mesh, limit);
    Py_END_ALLOW_THREADS
    return PyLong_FromLong(removed);
}

/* flip(state, criterion, limit, tolerance) -> (flips, places) */
static PyObject *flip_all(PyObject *self, PyObject *args)
{
    PyObject *capsule;
    int criterion;
    Aim aim;
    State *state;
    if (!PyArg_ParseTuple(args, "Oidd", &capsule, &criterion, &aim.limit, &aim.tolerance)
        || !(state = state_of(capsule)))
        return NULL;
    aim.criterion = (Criterion)criterion;
    int64_t flips;
    Py_BEGIN_ALLOW_THREADS
    flips = flip_edges(&state->mesh, &aim, &state->places);
    Py_END_ALLOW_THREADS
    return flips < 0 ? PyErr_NoMemory() : Py_BuildValue("Li", (long long)flips, state->places.count);
}

/* delaunay(state) -> share of the inner edges */
static PyObject *delaunay(PyObject *self, PyObject *capsule)
{
    State *state = state_of(capsule);
    double share;
    if (!state) return NULL;
    Py_BEGIN_ALLOW_THREADS
    share = delaunay_share(&state->mesh);
    Py_END_ALLOW_THREADS
    return PyFloat_FromDouble(share);
}

/* sort(state): in memory as on the surface; no slot stays free */
static PyObject *sort(PyObject *self, PyObject *capsule)
{
    State *state = state_of(capsule);
    int done;
    if (!state) return NULL;
    state->places.count = 0;
    Py_BEGIN_ALLOW_THREADS
    done = triangulation_sort(&state->mesh);
    Py_END_ALLOW_THREADS
    return done ? Py_NewRef(Py_None) : PyErr_NoMemory();
}

/* export(state, faces i(f,3), point_faces i(v,), weights d(v,3), mapped d(v,3)) */
static PyObject *export_arrays(PyObject *self, PyObject *args)
{
    PyObject *capsule, *o[4], *result = NULL;
    Arrays a;
    State *state;
    static const int columns[] = {3, 1, 3, 3};
    static const char *const names[] = {"faces", "point_faces", "weights", "mapped"};
    if (!PyArg_ParseTuple(args, "OOOOO", &capsule, &o[0], &o[1], &o[2], &o[3]) || !(state = state_of(capsule))
        || arrays_get(&a, o, "iidd", columns, names, 4) < 0)
        return NULL;
    Array *x = a.array;
    const Triangulation *mesh = &state->mesh;
    int32_t vertices = mesh->vertices, *point_faces = x[1].data;
    double *weights = x[2].data;
    if (mesh->used_faces != mesh->faces || mesh->used_vertices != vertices) {
        PyErr_SetString(PyExc_ValueError, "sort the state first");
    } else if (x[0].rows != mesh->faces || x[1].rows != vertices || x[2].rows != vertices || x[3].rows != vertices) {
        PyErr_Format(PyExc_ValueError, "need rows for %d vertices and %d faces", vertices, mesh->faces);
    } else {
        memcpy(x[0].data, mesh->corner, 3 * (size_t)mesh->faces * sizeof *mesh->corner);
        memcpy(x[3].data, mesh->mapped, 3 * (size_t)vertices * sizeof *mesh->mapped);
        for (int32_t v = 0; v < vertices; v++) {
            point_faces[v] = mesh->point[v].face;
            memcpy(weights + 3 * (size_t)v, mesh->point[v].weight, sizeof mesh->point[v].weight);
        }
        result = Py_NewRef(Py_None);
    }
    arrays_release(&a);
    return result;
}

/* find_edges(state, first, last) -> places, the middles of the edges in these faces */
static PyObject *find_edges(PyObject *self, PyObject *args)
{
    PyObject *capsule;
    int first, last, done;
    State *state;
    if (!PyArg_ParseTuple(args, "Oii", &capsule, &first, &last) || !(state = state_of(capsule))) return NULL;
    if (first < 0 || last < first || last > state->mesh.faces)
        return PyErr_Format(PyExc_IndexError, "there are no faces %d to %d", first, last);
    Py_BEGIN_ALLOW_THREADS
    done = find_edge_middles(&state->mesh, first, last, &state->places);
    Py_END_ALLOW_THREADS
    return done ? PyLong_FromLong(state->places.count) : PyErr_NoMemory();
}

/* measure_edges(state, mapped d(n,3), lengths d(f,3)): `mapped` is where the map takes the places of `find_edges`;
 * keep_triangles(state, lengths d(f,3)) once all are measured */
static PyObject *measure_lengths(PyObject *self, PyObject *args)
{
    PyObject *capsule, *o[2], *result = NULL;
    Arrays a;
    State *state;
    static const int columns[] = {3, 3};
    static const char *const names[] = {"mapped", "lengths"};
    if (!PyArg_ParseTuple(args, "OOO", &capsule, &o[0], &o[1]) || !(state = state_of(capsule))
        || arrays_get(&a, o, "dd", columns, names, 2) < 0)
        return NULL;
    Array *x = a.array;
    if (x[0].rows != state->places.count || x[1].rows != state->mesh.faces
        || state->mesh.used_faces != state->mesh.faces) {
        PyErr_Format(PyExc_ValueError, "sort the state first; need rows for %d edges and %d faces", state->places.count,
                     state->mesh.used_faces);
    } else {
        Py_BEGIN_ALLOW_THREADS
        measure_edges(&state->mesh, &state->places, x[0].data, x[1].data);
        state->places.count = 0;
        Py_END_ALLOW_THREADS
        result = Py_NewRef(Py_None);
    }
    arrays_release(&a);
    return result;
}

static PyObject *keep_faces(PyObject *self, PyObject *args)
{
    PyObject *capsule, *object;
    Array lengths;
    State *state;
    if (!PyArg_ParseTuple(args, "OO", &capsule, &object) || !(state = state_of(capsule))
        || array_get(object, &lengths, 'd', 3, 1, "lengths") < 0)
        return NULL;
    int fits = lengths.rows == state->mesh.faces && state->mesh.used_faces == state->mesh.faces;
    if (fits) {
        Py_BEGIN_ALLOW_THREADS
        keep_triangles(&state->mesh, lengths.data);
        Py_END_ALLOW_THREADS
    }
    array_release(&lengths);
    return fits ? Py_NewRef(Py_None)
                : PyErr_Format(PyExc_ValueError, "sort the state first; need rows for %d faces", state->mesh.used_faces);
}

/* edges(state, twins i(f,3), homes i(f,3), vectors d(f,6)) */
static PyObject *edges(PyObject *self, PyObject *args)
{
    PyObject *capsule, *o[3], *result = NULL;
    Arrays a;
    State *state;
    static const int columns[] = {3, 3, 6};
    static const char *const names[] = {"twins", "homes", "vectors"};
    if (!PyArg_ParseTuple(args, "OOOO", &capsule, &o[0], &o[1], &o[2]) || !(state = state_of(capsule))
        || arrays_get(&a, o, "iid", columns, names, 3) < 0)
        return NULL;
    Array *x = a.array;
    const Triangulation *mesh = &state->mesh;
    size_t half_edges = 3 * (size_t)mesh->faces;
    Py_ssize_t rows = mesh->faces;
    if (mesh->used_faces != rows || x[0].rows != rows || x[1].rows != rows || x[2].rows != rows) {
        PyErr_Format(PyExc_ValueError, "sort the state first; need rows for %d faces", mesh->used_faces);
    } else {
        memcpy(x[0].data, mesh->twin, half_edges * sizeof *mesh->twin);
        memcpy(x[1].data, mesh->home, half_edges * sizeof *mesh->home);
        memcpy(x[2].data, mesh->vector, half_edges * sizeof *mesh->vector);
        result = Py_NewRef(Py_None);
    }
    arrays_release(&a);
    return result;
}

/* edit(state, kind, item) -> whether half-edge `item` was flipped (kind 0), or vertex `item` removed (kind 1) */
static PyObject *edit(PyObject *self, PyObject *args)
{
    PyObject *capsule;
    int kind, item;
    State *state;
    if (!PyArg_ParseTuple(args, "Oii", &capsule, &kind, &item) || !(state = state_of(capsule))) return NULL;
    Triangulation *mesh = &state->mesh;
    if (item < 0 || (kind == 0 ? item >= 3 * mesh->faces || mesh->corner[item] < 0
                               : item >= mesh->vertices || mesh->outgoing[item] < 0))
        return PyErr_Format(PyExc_IndexError, "there is no half-edge or vertex %d", item);
    state->places.count = 0;
    return PyBool_FromLong(kind == 0 ? flip_if_valid(mesh, item) : remove_vertex(mesh, item));
}

static PyMethodDef methods[] = {
    {"create", create, METH_VARARGS, "create(positions, faces, twins, mapped) -> state"},
    {"size", size, METH_O, "size(state) -> (vertices, faces)"},
    {"measure", measure, METH_O, "measure(state) -> (area, longest edge)"},
    {"find_long", find_long, METH_VARARGS, "find_long(state, limit, along) -> (places, refused)"},
    {"find_folded", find_folded, METH_O, "find_folded(state) -> places"},
    {"find_moves", find_shifts, METH_VARARGS, "find_moves(state, folded, limit) -> places"},
    {"places", places, METH_VARARGS, "places(state, faces, weights)"},
    {"split", split, METH_VARARGS, "split(state, mapped) -> (refused, 0)"},
    {"move", move, METH_VARARGS, "move(state, mapped) -> (moves, 0)"},
    {"remove_short", remove_short, METH_VARARGS, "remove_short(state, limit) -> removed"},
    {"flip", flip_all, METH_VARARGS, "flip(state, criterion, limit, tolerance) -> (flips, places)"},
    {"flip_held", flip_held, METH_VARARGS, "flip_held(state, mapped) -> (flips, places)"},
    {"delaunay", delaunay, METH_O, "delaunay(state) -> share of the inner edges"},
    {"sort", sort, METH_O, "sort(state)"},
    {"export", export_arrays, METH_VARARGS, "export(state, faces, point_faces, weights, mapped)"},
    {"find_edges", find_edges, METH_VARARGS, "find_edges(state, first, last) -> places"},
    {"measure_edges", measure_lengths, METH_VARARGS, "measure_edges(state, mapped, lengths)"},
    {"keep_triangles", keep_faces, METH_VARARGS, "keep_triangles(state, lengths)"},
    {"edges", edges, METH_VARARGS, "edges(state, twins, homes, vectors)"},
    {"edit", edit, METH_VARARGS, "edit(state, kind, item) -> done"},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_remesh", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__remesh(void) { return PyModule_Create(&module); }
