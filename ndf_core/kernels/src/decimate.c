/* Quadric edge collapse that keeps the topology: every collapse satisfies the link condition, boundary included, and
 * turns or flattens no triangle beyond stated limits. One global queue; the same result on every machine. */
#include "arrays.h"

#include "corner_mesh.h"
#include "edge_heap.h"
#include "quadric.h"

typedef struct {
    double regularisation; /* s of quadric.h */
    double boundary;       /* weight of the planes through boundary edges */
    double shape;          /* how strongly thin triangles raise the cost */
    double altitude;       /* least altitude of a new triangle, relative to the longest side */
} Options;

/* Limits, from strict to lax; the next line is taken when no edge passes the present one. */
static const struct { double cosine; } STAGES[] = {{0.5}, {0.26}};
enum { STAGE_COUNT = 2 };

/* Area over the sum of the squared sides below which a triangle is a sliver; 0.289 is equilateral. */
static const double SLIVER = 0.003;

/* Flips before the collapses leave flat regions flat to rounding; those after turn no normal by more than 3 degrees. */
static const double FLAT = 1 - 1e-9, NEARLY_FLAT = 0.9986;

typedef struct {
    CornerMesh mesh;
    Heap heap;
    double (*position)[3];
    Quadric *quadric;
    int32_t *mark, *parent;
    uint8_t *moved, *parked;
    int32_t stamp, live_faces, stage;
    Options options;
} Work;

static inline int32_t edge_id(const CornerMesh *mesh, int32_t h)
{
    int32_t g = mesh->opposite[h];
    return g >= 0 && g < h ? g : h;
}

static double face_normal(const double a[3], const double b[3], const double c[3], double normal[3])
{
    double u[3], v[3];
    subtract(b, a, u);
    subtract(c, a, v);
    cross(u, v, normal);
    return sqrt(dot(normal, normal));
}

static double squared_distance(const double a[3], const double b[3])
{
    double d[3];
    subtract(a, b, d);
    return dot(d, d);
}

static void face_quadrics(Work *work, const double *weights)
{
    CornerMesh *mesh = &work->mesh;
    for (int32_t face = 0; face < mesh->faces; face++) {
        double normal[3], *p[3];
        for (int i = 0; i < 3; i++) p[i] = work->position[mesh->corner[3 * face + i]];
        double area = face_normal(p[0], p[1], p[2], normal);
        if (!(area > 0)) continue;
        for (int i = 0; i < 3; i++) normal[i] /= area;
        Quadric q = {0};
        double third = area / 6;
        quadric_add_plane(&q, normal, p[0], third);
        quadric_add_patch(&q, p[0], p[1], p[2], third * work->options.regularisation * work->options.regularisation);
        for (int i = 0; i < 3; i++) {
            Quadric scaled = q;
            double *entry = (double *)&scaled, weight = weights[mesh->corner[3 * face + i]];
            for (int k = 0; k < 10; k++) entry[k] *= weight;
            quadric_add(&work->quadric[mesh->corner[3 * face + i]], &scaled);
        }
        for (int i = 0; i < 3; i++) {
            if (mesh->opposite[3 * face + i] >= 0) continue;
            double edge[3], side[3];
            subtract(p[(i + 1) % 3], p[i], edge);
            cross(edge, normal, side);
            double length = sqrt(dot(side, side));
            if (!(length > 0)) continue;
            for (int k = 0; k < 3; k++) side[k] /= length;
            for (int k = 0; k < 2; k++)
                quadric_add_plane(&work->quadric[mesh->corner[3 * face + (i + k) % 3]], side, p[i],
                                  work->options.boundary * length * length / 2);
        }
    }
}

/* Where to put the vertex that replaces the edge h, and the quadric error there. */
static double place(const Work *work, int32_t h, double at[3])
{
    const CornerMesh *mesh = &work->mesh;
    int32_t a = mesh->corner[h], b = end_of(mesh, h);
    const double *p = work->position[a], *q = work->position[b];
    Quadric sum = work->quadric[a];
    quadric_add(&sum, &work->quadric[b]);
    double middle[3], length = squared_distance(p, q);
    for (int i = 0; i < 3; i++) at[i] = middle[i] = 0.5 * (p[i] + q[i]);
    if (quadric_minimise(&sum, at) && squared_distance(at, middle) <= 4 * length) return quadric_value(&sum, at);
    const double *candidates[3] = {middle, p, q};
    double best = INFINITY;
    for (int i = 0; i < 3; i++) {
        double value = quadric_value(&sum, candidates[i]);
        if (value < best) {
            best = value;
            for (int k = 0; k < 3; k++) at[k] = candidates[i][k];
        }
    }
    return best;
}

/* The link condition of Dey, Edelsbrunner, Guha and Nekhayev (1999), the boundary coned to one extra vertex. */
static int link_condition(Work *work, int32_t h)
{
    const CornerMesh *mesh = &work->mesh;
    int32_t a = mesh->corner[h], b = end_of(mesh, h), g = mesh->opposite[h];
    int boundary_a = on_boundary(mesh, a), boundary_b = on_boundary(mesh, b);
    if (g >= 0 && boundary_a && boundary_b) return 0;
    int32_t c = mesh->corner[previous(h)], d = g >= 0 ? mesh->corner[previous(g)] : -1;
    if (c == d) return 0;
    if (g < 0 && mesh->opposite[next(h)] < 0 && mesh->opposite[previous(h)] < 0) return 0;
    int32_t stamp = ++work->stamp, valence_a = 0, valence_b = 0, common = 0, k, start;
    for (k = start = mesh->outgoing[a];;) {
        work->mark[end_of(mesh, k)] = stamp;
        valence_a++;
        int32_t following = turn(mesh, k);
        if (following < 0) {
            work->mark[mesh->corner[previous(k)]] = stamp;
            valence_a++;
        }
        if ((k = following) < 0 || k == start) break;
    }
    for (k = start = mesh->outgoing[b];;) {
        common += work->mark[end_of(mesh, k)] == stamp;
        valence_b++;
        int32_t following = turn(mesh, k);
        if (following < 0) {
            common += work->mark[mesh->corner[previous(k)]] == stamp;
            valence_b++;
        }
        if ((k = following) < 0 || k == start) break;
    }
    if (common != (g >= 0 ? 2 : 1)) return 0;
    return !(valence_a == 3 && valence_b == 3 && !boundary_a && !boundary_b);
}

/* Measures of the triangles around an edge. */
typedef struct { double quality_before, altitude_before, quality, altitude; int turned; } Ring;

static int turned(const Work *work, int32_t v, const double before[3], const double after[3], double bound, int sliver)
{
    if (!sliver) return dot(before, after) < bound;
    /* The normal of a sliver is noise; ask the fan instead, and only for the side. */
    const CornerMesh *mesh = &work->mesh;
    int32_t start = mesh->outgoing[v], k = start;
    double sum[3] = {0, 0, 0}, normal[3];
    do {
        face_normal(work->position[v], work->position[end_of(mesh, k)], work->position[mesh->corner[previous(k)]], normal);
        for (int i = 0; i < 3; i++) sum[i] += normal[i];
        k = turn(mesh, k);
    } while (k >= 0 && k != start);
    return dot(sum, after) < 0;
}

static void measure_fan(const Work *work, int32_t v, int32_t face1, int32_t face2, const double at[3], double cosine, Ring *ring)
{
    const CornerMesh *mesh = &work->mesh;
    int32_t start = mesh->outgoing[v], k = start;
    do {
        const double *p = work->position[v], *q = work->position[end_of(mesh, k)];
        const double *r = work->position[mesh->corner[previous(k)]];
        double before[3], after[3], opposite = squared_distance(q, r);
        double area = face_normal(p, q, r, before), u = squared_distance(p, q), w = squared_distance(p, r);
        double longest = fmax(opposite, fmax(u, w)), quality = area / (opposite + u + w + 1e-300);
        double altitude = area / sqrt(longest + 1e-300);
        double quality_old = quality;
        if (quality < ring->quality_before) ring->quality_before = quality;
        if (altitude < ring->altitude_before) ring->altitude_before = altitude;
        if (k / 3 != face1 && k / 3 != face2) {
            double new_area = face_normal(at, q, r, after);
            u = squared_distance(at, q);
            w = squared_distance(at, r);
            longest = fmax(opposite, fmax(u, w));
            quality = new_area / (opposite + u + w + 1e-300);
            altitude = new_area / sqrt(longest + 1e-300);
            if (quality < ring->quality) ring->quality = quality;
            if (altitude < ring->altitude) ring->altitude = altitude;
            ring->turned = turned(work, v, before, after, cosine * area * new_area, quality_old < SLIVER);
        }
        k = turn(mesh, k);
    } while (k >= 0 && k != start && !ring->turned);
}

/* Cost with the shape of the new triangles, or infinity where one would turn too far or get too thin. */
static double full_cost(Work *work, int32_t h, double at[3])
{
    const CornerMesh *mesh = &work->mesh;
    double cost = place(work, h, at);
    int32_t g = mesh->opposite[h], face1 = h / 3, face2 = g >= 0 ? g / 3 : -1;
    Ring ring = {1, INFINITY, 1, INFINITY, 0};
    double cosine = STAGES[work->stage].cosine;
    measure_fan(work, mesh->corner[h], face1, face2, at, cosine, &ring);
    if (!ring.turned) measure_fan(work, end_of(mesh, h), face1, face2, at, cosine, &ring);
    if (ring.turned) return INFINITY;
    if (ring.altitude < work->options.altitude && ring.altitude < ring.altitude_before) return INFINITY;
    double quality = 2 * sqrt(3.0) * fmax(ring.quality, 0.5 * ring.quality_before);
    return quality < 1 ? cost * pow(fmax(quality, 1e-3), -work->options.shape) : cost;
}

static void enqueue(Work *work, int32_t h)
{
    double at[3];
    int32_t id = edge_id(&work->mesh, h);
    work->parked[id] = 0;
    heap_set(&work->heap, id, place(work, id, at));
}

/* The triangles around v changed, so what was refused there may be allowed now. */
static void unpark_around(Work *work, int32_t v)
{
    const CornerMesh *mesh = &work->mesh;
    int32_t start = mesh->outgoing[v], k = start;
    do {
        int32_t id = edge_id(mesh, k);
        if (work->parked[id]) enqueue(work, id);
        k = turn(mesh, k);
    } while (k >= 0 && k != start);
}

static void collapse(Work *work, int32_t h, const double at[3])
{
    CornerMesh *mesh = &work->mesh;
    int32_t a = mesh->corner[h], b = end_of(mesh, h), sides[2] = {h, mesh->opposite[h]};
    heap_remove(&work->heap, edge_id(mesh, h));
    for (int side = 0; side < 2 && sides[side] >= 0; side++) {
        heap_remove(&work->heap, edge_id(mesh, next(sides[side])));
        heap_remove(&work->heap, edge_id(mesh, previous(sides[side])));
    }
    work->live_faces -= sides[1] >= 0 ? 2 : 1;
    collapse_edge(mesh, h);
    quadric_add(&work->quadric[a], &work->quadric[b]);
    for (int i = 0; i < 3; i++) work->position[a][i] = at[i];
    work->parent[b] = a;
    work->moved[a] = 1;
    int32_t start = mesh->outgoing[a], k = start;
    do {
        enqueue(work, k);
        if (mesh->opposite[previous(k)] < 0) enqueue(work, previous(k));
        k = turn(mesh, k);
    } while (k >= 0 && k != start);
    k = start;
    do {
        unpark_around(work, end_of(mesh, k));
        k = turn(mesh, k);
    } while (k >= 0 && k != start);
}

static void enqueue_all(Work *work)
{
    for (int32_t h = 0; h < 3 * work->mesh.faces; h++)
        if (work->mesh.corner[h] >= 0 && edge_id(&work->mesh, h) == h) enqueue(work, h);
}

/* The quadric error bounds the full cost from below, so the full cost is only worked out for the front of the queue. */
static void run(Work *work, int32_t target)
{
    for (work->stage = 0; work->stage < STAGE_COUNT && work->live_faces > target;) {
        int32_t before = work->live_faces;
        enqueue_all(work);
        while (work->live_faces > target && work->heap.count) {
            int32_t h = work->heap.entries[0].id;
            double at[3], cost = full_cost(work, h, at);
            if (isfinite(cost) && cost > work->heap.entries[0].key) {
                heap_set(&work->heap, h, cost);
            } else if (isfinite(cost) && link_condition(work, h)) {
                collapse(work, h, at);
            } else {
                heap_remove(&work->heap, h);
                work->parked[h] = 1;
            }
        }
        if (work->live_faces > before - (before - target) / 50 - 1) work->stage++;
    }
}

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
