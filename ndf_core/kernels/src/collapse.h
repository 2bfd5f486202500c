/* The queue of edge collapses: what each costs, which are allowed, and the loop that carries them out. */
#ifndef NDF_COLLAPSE_H
#define NDF_COLLAPSE_H

#include <string.h>

#include "corner_mesh.h"
#include "edge_heap.h"
#include "quadric.h"

typedef struct {
    double regularisation; /* s of quadric.h */
    double boundary;       /* weight of the planes through boundary edges */
    double shape;          /* how strongly thin triangles raise the cost */
    double altitude;       /* least altitude of a new triangle, relative to the longest side */
} Options;

/* Least cosine between the normals of a triangle before and after a collapse: 60 degrees, and 75 when no edge is left
 * that passes. */
static const double COSINES[] = {0.5, 0.26};
enum { STAGE_COUNT = 2 };

/* Area over the sum of the squared sides below which a triangle is a sliver; 0.289 is equilateral. */
static const double SLIVER = 0.003;

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
    double cosine = COSINES[work->stage];
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
        /* Refused edges that a collapse farther away has freed are tried again as long as that pays. */
        if (before - work->live_faces <= (before - target) / 50) work->stage++;
    }
}

#endif
