/* Quadric edge collapse that keeps the topology: every collapse satisfies the link condition, boundary included, and
 * turns or flattens no triangle beyond stated limits. One global queue; the same result on every machine. */
#include "arrays.h"

#include "collapse.h"

/* Flips before the collapses leave flat regions flat to rounding; those after turn no normal by more than 3 degrees. */
static const double FLAT = 1 - 1e-9, NEARLY_FLAT = 0.9986;

static int adjacent(const CornerMesh *mesh, int32_t v, int32_t w)
{
    int32_t start = mesh->outgoing[v], k = start;
    do {
        if (end_of(mesh, k) == w || mesh->corner[previous(k)] == w) return 1;
        k = turn(mesh, k);
    } while (k >= 0 && k != start);
    return 0;
}

static double cotangent(const double apex[3], const double p[3], const double q[3])
{
    double u[3], v[3], w[3];
    subtract(p, apex, u);
    subtract(q, apex, v);
    cross(u, v, w);
    return dot(u, v) / (sqrt(dot(w, w)) + 1e-300);
}

/* Whether turning the edge gives better triangles (Delaunay's criterion) without moving the surface noticeably. */
static int worth_flipping(const Work *work, int32_t h, double cosine)
{
    const CornerMesh *mesh = &work->mesh;
    int32_t g = mesh->opposite[h];
    if (g < 0) return 0;
    int32_t id[4] = {mesh->corner[h], mesh->corner[g], mesh->corner[previous(h)], mesh->corner[previous(g)]};
    const double *a = work->position[id[0]], *b = work->position[id[1]], *c = work->position[id[2]], *d = work->position[id[3]];
    if (cotangent(c, a, b) + cotangent(d, a, b) > -0.02) return 0;
    double old[2][3], new[2][3], size[4] = {face_normal(a, b, c, old[0]), face_normal(b, a, d, old[1]),
                                            face_normal(a, d, c, new[0]), face_normal(d, b, c, new[1])};
    double smallest = fmin(size[2], size[3]), side = sqrt(squared_distance(c, d));
    if (!(smallest > work->options.altitude * side) && smallest <= fmin(size[0], size[1])) return 0;
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2; k++)
            if (dot(old[i], new[k]) < cosine * size[i] * size[2 + k]) return 0;
    return !adjacent(mesh, id[2], id[3]);
}

/* Lawson's flips where the surface is nearly flat. */
static void flip(Work *work, double cosine)
{
    for (int pass = 0, flipped = 1; pass < 20 && flipped; pass++) {
        flipped = 0;
        for (int32_t h = 0; h < 3 * work->mesh.faces; h++)
            if (work->mesh.corner[h] >= 0 && edge_id(&work->mesh, h) == h && worth_flipping(work, h, cosine)) {
                flip_edge(&work->mesh, h);
                flipped = 1;
            }
    }
}

static int work_create(Work *work, const int32_t *faces, size_t face_count, size_t vertex_count)
{
    memset(work, 0, sizeof *work);
    int result = corner_mesh_create(&work->mesh, faces, face_count, vertex_count);
    if (result) return result;
    work->position = malloc((vertex_count + 1) * sizeof *work->position);
    work->quadric = calloc(vertex_count + 1, sizeof *work->quadric);
    work->mark = calloc(vertex_count + 1, sizeof *work->mark);
    work->parent = malloc((vertex_count + 1) * sizeof *work->parent);
    work->moved = calloc(vertex_count + 1, 1);
    work->parked = calloc(3 * face_count + 1, 1);
    work->live_faces = (int32_t)face_count;
    if (heap_create(&work->heap, 3 * face_count)) return -2;
    return work->position && work->quadric && work->mark && work->parent && work->moved && work->parked ? 0 : -2;
}

static void work_destroy(Work *work)
{
    corner_mesh_destroy(&work->mesh);
    heap_destroy(&work->heap);
    free(work->position);
    free(work->quadric);
    free(work->mark);
    free(work->parent);
    free(work->moved);
    free(work->parked);
}

/* Centre and longest side of the bounding box. */
static double frame(const double (*vertices)[3], size_t count, double centre[3])
{
    double longest = 0;
    for (int i = 0; i < 3; i++) {
        double low = INFINITY, high = -INFINITY;
        for (size_t v = 0; v < count; v++) {
            low = fmin(low, vertices[v][i]);
            high = fmax(high, vertices[v][i]);
        }
        centre[i] = 0.5 * (low + high);
        longest = fmax(longest, high - low);
    }
    return longest > 0 ? longest : 1;
}

/* Write the live mesh over the input arrays, numbered in the old order; vertices that never moved keep their bits. */
static size_t write_back(Work *work, double (*vertices)[3], int32_t *faces, int32_t *cluster, const double centre[3], double scale)
{
    CornerMesh *mesh = &work->mesh;
    int32_t kept = 0, written = 0;
    for (int32_t v = 0; v < mesh->vertices; v++) {
        cluster[v] = -1;
        if (mesh->outgoing[v] < 0) continue;
        for (int i = 0; i < 3; i++)
            vertices[kept][i] = work->moved[v] ? work->position[v][i] * scale + centre[i] : vertices[v][i];
        cluster[v] = kept++;
    }
    for (int32_t v = 0; v < mesh->vertices; v++) {
        int32_t root = v;
        while (work->parent[root] >= 0) root = work->parent[root];
        for (int32_t at = v, up; work->parent[at] >= 0; at = up) {
            up = work->parent[at];
            work->parent[at] = root;
        }
        if (root != v) cluster[v] = cluster[root];
    }
    for (int32_t face = 0; face < mesh->faces; face++) {
        if (mesh->corner[3 * face] < 0) continue;
        for (int i = 0; i < 3; i++) faces[3 * written + i] = cluster[mesh->corner[3 * face + i]];
        written++;
    }
    return (size_t)kept;
}

static PyObject *decimate(PyObject *module, PyObject *arguments)
{
    (void)module;
    PyObject *objects[4];
    int target;
    Options options;
    if (!PyArg_ParseTuple(arguments, "OOOOidddd", &objects[0], &objects[1], &objects[2], &objects[3], &target,
                          &options.regularisation, &options.boundary, &options.shape, &options.altitude))
        return NULL;
    Array vertices, faces, weights, cluster;
    PyObject *answer = NULL;
    int result = 0;
    if (array_get(objects[0], &vertices, 'd', 3, 1, "vertices") < 0) return NULL;
    if (array_get(objects[1], &faces, 'i', 3, 1, "faces") < 0) goto release1;
    if (array_get(objects[2], &weights, 'd', 1, 0, "weights") < 0) goto release2;
    if (array_get(objects[3], &cluster, 'i', 1, 1, "cluster") < 0) goto release3;
    size_t count = (size_t)vertices.rows, face_count = (size_t)faces.rows, kept = 0;
    const int32_t *index = faces.data;
    if (face_count > INT32_MAX / 3 - 1 || count > INT32_MAX - 1 || weights.rows != vertices.rows || cluster.rows != vertices.rows)
        result = -3;
    for (size_t i = 0; i < 3 * face_count && !result; i++)
        if (index[i] < 0 || (size_t)index[i] >= count) result = -4;
    Work work;
    memset(&work, 0, sizeof work);
    if (!result) {
        Py_BEGIN_ALLOW_THREADS
        result = work_create(&work, index, face_count, count);
        if (!result) {
            double centre[3], (*points)[3] = vertices.data, scale = frame((const double (*)[3])points, count, centre);
            for (size_t v = 0; v < count; v++) {
                work.parent[v] = -1;
                for (int i = 0; i < 3; i++) work.position[v][i] = (points[v][i] - centre[i]) / scale;
            }
            work.options = options;
            face_quadrics(&work, weights.data);
            if (work.live_faces > target) {
                flip(&work, FLAT);
                run(&work, target);
                flip(&work, NEARLY_FLAT);
            }
            kept = write_back(&work, points, faces.data, cluster.data, centre, scale);
        }
        Py_END_ALLOW_THREADS
    }
    if (result == 0) answer = Py_BuildValue("nn", (Py_ssize_t)kept, (Py_ssize_t)work.live_faces);
    else if (result == -1) PyErr_SetString(PyExc_ValueError, "faces: not an oriented manifold");
    else if (result == -2) PyErr_NoMemory();
    else if (result == -3) PyErr_SetString(PyExc_ValueError, "too many faces, or weights or cluster of another length");
    else PyErr_SetString(PyExc_ValueError, "faces: index out of range");
    if (result == 0 || result == -1 || result == -2) work_destroy(&work);
    array_release(&cluster);
release3:
    array_release(&weights);
release2:
    array_release(&faces);
release1:
    array_release(&vertices);
    return answer;
}

static PyMethodDef METHODS[] = {
    {"decimate", decimate, METH_VARARGS,
     "decimate(vertices, faces, weights, cluster, target, regularisation, boundary, shape, altitude) -> (vertex_count, face_count); "
     "overwrites the first rows of vertices and faces, and cluster"},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "_decimate", NULL, -1, METHODS, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__decimate(void) { return PyModule_Create(&MODULE); }
