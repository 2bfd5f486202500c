/* A triangulation of a `Surface` whose edges are straight lines on it: vertices are points of the surface, and every
 * half-edge knows in which face it leaves its vertex and the vector to its end, unfolded into that face's plane.
 * The corners of the surface stay vertices; so all faces are flat, and lengths alone lay them out.
 */
#ifndef NDF_TRIANGULATION_H
#define NDF_TRIANGULATION_H

#include <stddef.h>
#include <string.h>
#include "unfolding.h"

#define NONE -1

typedef struct {
    const Surface *surface;
    int32_t faces, vertices;               /* slots in use, freed ones included */
    int32_t face_capacity, vertex_capacity;
    int32_t *corner, *twin, *home;         /* by half-edge; corner NONE in a freed face */
    Vector *vector;                        /* by half-edge, in the plane of its home */
    uint8_t *settled;                      /* by half-edge: passes of flips looked at it, and its faces did not change */
    int sorted;                            /* as `triangulation_sort` left it */
    int settled_for;                       /* the criterion of these passes, and their tolerance */
    double settled_within;
    Point *point;                          /* by vertex */
    double *mapped;                        /* by vertex: three coordinates */
    int32_t *outgoing;                     /* by vertex: a half-edge that leaves it; NONE if freed */
    uint8_t *border;                       /* by vertex */
    int32_t free_face, free_vertex;        /* lists through `twin` and `point.face` */
    int32_t used_faces, used_vertices;
} Triangulation;

static inline int32_t end_of(const Triangulation *mesh, int32_t h) { return mesh->corner[next(h)]; }

/* The next half-edge around a vertex, anticlockwise and clockwise; NONE beyond a border. */
static inline int32_t turn_left(const Triangulation *mesh, int32_t h) { return mesh->twin[previous(h)]; }
static inline int32_t turn_right(const Triangulation *mesh, int32_t h)
{
    return mesh->twin[h] < 0 ? NONE : next(mesh->twin[h]);
}

/* The half-edge to start with on the way around a vertex anticlockwise. */
static int32_t first_around(const Triangulation *mesh, int32_t v)
{
    int32_t start = mesh->outgoing[v], h = start;
    if (!mesh->border[v]) return h;
    do {
        if (mesh->twin[h] < 0) return h;
        h = next(mesh->twin[h]);
    } while (h != start);
    return h;
}

static int are_neighbours(const Triangulation *mesh, int32_t v, int32_t w)
{
    int32_t start = first_around(mesh, v), h = start;
    do {
        if (end_of(mesh, h) == w || mesh->corner[previous(h)] == w) return 1;
        h = turn_left(mesh, h);
    } while (h >= 0 && h != start);
    return 0;
}

static void link_twins(Triangulation *mesh, int32_t h, int32_t g)
{
    mesh->twin[h] = g;
    if (g >= 0) mesh->twin[g] = h;
}

/* Give half-edge `to` the place of `from`: its vertex, its vector and its other side. */
static void move_half_edge(Triangulation *mesh, int32_t to, int32_t from)
{
    mesh->corner[to] = mesh->corner[from];
    mesh->home[to] = mesh->home[from];
    mesh->vector[to] = mesh->vector[from];
    link_twins(mesh, to, mesh->twin[from]);
}

/* A face has changed: let passes of flips look again at its edges. */
static void unsettle(Triangulation *mesh, int32_t face)
{
    mesh->sorted = 0;
    for (int32_t h = 3 * face; h < 3 * face + 3; h++) {
        mesh->settled[h] = 0;
        if (mesh->twin[h] >= 0) mesh->settled[mesh->twin[h]] = 0;
    }
}

static void settle(Triangulation *mesh, int32_t h)
{
    mesh->settled[h] = mesh->settled[mesh->twin[h]] = 1;
}

/* ---- slots ---- */

static int32_t new_face(Triangulation *mesh)
{
    int32_t f = mesh->free_face;
    mesh->used_faces++;
    if (f == NONE) return mesh->faces++;
    mesh->free_face = mesh->twin[3 * f];
    return f;
}

static void free_face(Triangulation *mesh, int32_t f)
{
    for (int32_t h = 3 * f; h < 3 * f + 3; h++) mesh->corner[h] = mesh->twin[h] = NONE;
    mesh->twin[3 * f] = mesh->free_face;
    mesh->free_face = f;
    mesh->used_faces--;
}

static int32_t new_vertex(Triangulation *mesh)
{
    int32_t v = mesh->free_vertex;
    mesh->used_vertices++;
    if (v == NONE) return mesh->vertices++;
    mesh->free_vertex = mesh->point[v].face;
    return v;
}

static void free_vertex(Triangulation *mesh, int32_t v)
{
    mesh->outgoing[v] = NONE;
    mesh->point[v].face = mesh->free_vertex;
    mesh->free_vertex = v;
    mesh->used_vertices--;
}

/* ---- the first triangulation: the faces of the surface ---- */

static void triangulation_free(Triangulation *mesh)
{
    free(mesh->corner);
    free(mesh->twin);
    free(mesh->home);
    free(mesh->vector);
    free(mesh->settled);
    free(mesh->point);
    free(mesh->mapped);
    free(mesh->outgoing);
    free(mesh->border);
}

static int resize(void **array, size_t count, size_t size)
{
    void *larger = realloc(*array, (count + 1) * size);
    if (larger) *array = larger;
    return larger != NULL;
}

/* Room for this many more vertices and twice as many faces. Returns 0 without memory. */
static int triangulation_reserve(Triangulation *mesh, int64_t more)
{
    int64_t vertices = mesh->vertices + more, faces = mesh->faces + 2 * more;
    if (faces > INT32_MAX / 3) return 0;
    int done = 1;
    if (vertices > mesh->vertex_capacity) {
        size_t count = (size_t)vertices;
        done = resize((void **)&mesh->point, count, sizeof(Point)) && resize((void **)&mesh->outgoing, count, 4)
            && resize((void **)&mesh->mapped, 3 * count, sizeof(double)) && resize((void **)&mesh->border, count, 1);
        mesh->vertex_capacity = done ? (int32_t)vertices : mesh->vertex_capacity;
    }
    if (done && faces > mesh->face_capacity) {
        size_t count = 3 * (size_t)faces;
        done = resize((void **)&mesh->corner, count, 4) && resize((void **)&mesh->twin, count, 4)
            && resize((void **)&mesh->home, count, 4) && resize((void **)&mesh->vector, count, sizeof(Vector))
            && resize((void **)&mesh->settled, count, 1);
        mesh->face_capacity = done ? (int32_t)faces : mesh->face_capacity;
    }
    return done;
}

/* `vertices` counts the corners of the surface, all of them used. Returns 0 without memory. */
static int triangulation_create(Triangulation *mesh, const Surface *surface, int32_t vertices)
{
    *mesh = (Triangulation){.surface = surface, .free_face = NONE, .free_vertex = NONE};
    if (!triangulation_reserve(mesh, vertices > surface->faces / 2 ? vertices : surface->faces / 2 + 1)) return 0;
    mesh->faces = mesh->used_faces = surface->faces;
    mesh->vertices = mesh->used_vertices = vertices;
    memset(mesh->border, 0, (size_t)vertices);
    memset(mesh->settled, 0, 3 * (size_t)surface->faces);
    for (int32_t h = 0; h < 3 * surface->faces; h++) {
        int32_t v = surface->corners[h];
        mesh->corner[h] = v;
        mesh->twin[h] = surface->twins[h];
        mesh->home[h] = h / 3;
        mesh->vector[h] = minus(surface->corner[next(h)], surface->corner[h]);
        mesh->outgoing[v] = h;
        mesh->point[v] = (Point){{h % 3 == 0, h % 3 == 1, h % 3 == 2}, h / 3};
        if (surface->twins[h] < 0) mesh->border[v] = mesh->border[surface->corners[next(h)]] = 1;
    }
    return 1;
}

/* ---- order in memory ---- */

/* The slots in use, sorted by their place on the surface: `bucket` is its face, negative for a freed slot. `number`
 * gets the new slot of each, `starts` is scratch of an entry per face of the surface and one. */
static void order_slots(const Surface *surface, const int32_t *bucket, size_t stride, int32_t count, int32_t *order,
                        int32_t *number, int32_t *starts)
{
    memset(starts, 0, ((size_t)surface->faces + 1) * sizeof *starts);
    for (int32_t i = 0; i < count; i++)
        if (bucket[stride * (size_t)i] >= 0) starts[bucket[stride * (size_t)i] + 1]++;
    for (int32_t f = 0; f < surface->faces; f++) starts[f + 1] += starts[f];
    for (int32_t i = 0; i < count; i++) {
        int32_t place = bucket[stride * (size_t)i];
        number[i] = place < 0 ? NONE : starts[place]++;
        if (place >= 0) order[number[i]] = i;
    }
}

#define WIDEST (3 * sizeof(Vector)) /* bytes of a row */

/* Put rows of `size` bytes in order, by way of `scratch`, since memory that is used again costs less than new memory. */
static void reorder(void *array, const int32_t *order, int32_t count, size_t size, char *scratch)
{
    for (int32_t i = 0; i < count; i++)
        memcpy(scratch + size * (size_t)i, (char *)array + size * (size_t)order[i], size);
    memcpy(array, scratch, size * (size_t)count);
}

static void sort_faces(Triangulation *mesh, int32_t *order, int32_t *number, int32_t *starts, char *scratch)
{
    for (int32_t f = 0; f < mesh->faces; f++)
        if (mesh->corner[3 * f] < 0) mesh->home[3 * f] = NONE;
    order_slots(mesh->surface, mesh->home, 3, mesh->faces, order, number, starts);
    for (int32_t h = 0; h < 3 * mesh->faces; h++)
        if (mesh->twin[h] >= 0) mesh->twin[h] = 3 * number[mesh->twin[h] / 3] + mesh->twin[h] % 3;
    for (int32_t v = 0; v < mesh->vertices; v++)
        if (mesh->outgoing[v] >= 0) mesh->outgoing[v] = 3 * number[mesh->outgoing[v] / 3] + mesh->outgoing[v] % 3;
    mesh->faces = mesh->used_faces;
    mesh->free_face = NONE;
    reorder(mesh->corner, order, mesh->faces, 3 * sizeof *mesh->corner, scratch);
    reorder(mesh->twin, order, mesh->faces, 3 * sizeof *mesh->twin, scratch);
    reorder(mesh->home, order, mesh->faces, 3 * sizeof *mesh->home, scratch);
    reorder(mesh->vector, order, mesh->faces, 3 * sizeof *mesh->vector, scratch);
    reorder(mesh->settled, order, mesh->faces, 3 * sizeof *mesh->settled, scratch);
}

/* After `sort_faces`: every face is in use. */
static void sort_vertices(Triangulation *mesh, int32_t *order, int32_t *number, int32_t *starts, char *scratch)
{
    for (int32_t v = 0; v < mesh->vertices; v++)
        if (mesh->outgoing[v] < 0) mesh->point[v].face = NONE;
    const char *bucket = (const char *)mesh->point + offsetof(Point, face);
    order_slots(mesh->surface, (const int32_t *)bucket, sizeof(Point) / 4, mesh->vertices, order, number, starts);
    for (int32_t h = 0; h < 3 * mesh->faces; h++) mesh->corner[h] = number[mesh->corner[h]];
    mesh->vertices = mesh->used_vertices;
    mesh->free_vertex = NONE;
    reorder(mesh->point, order, mesh->vertices, sizeof *mesh->point, scratch);
    reorder(mesh->mapped, order, mesh->vertices, 3 * sizeof *mesh->mapped, scratch);
    reorder(mesh->outgoing, order, mesh->vertices, sizeof *mesh->outgoing, scratch);
    reorder(mesh->border, order, mesh->vertices, sizeof *mesh->border, scratch);
}

/* Renumber so that neighbours on the surface are neighbours in memory, which is what passes over large meshes cost,
 * and no slot is free. Returns 0 without memory. */
static int triangulation_sort(Triangulation *mesh)
{
    if (mesh->sorted) return 1;
    size_t most = (size_t)(mesh->faces > mesh->vertices ? mesh->faces : mesh->vertices) + 1;
    int32_t *order = malloc(most * sizeof *order), *number = malloc(most * sizeof *number);
    int32_t *starts = malloc(((size_t)mesh->surface->faces + 1) * sizeof *starts);
    char *scratch = malloc(most * WIDEST);
    int done = order && number && starts && scratch;
    if (done) {
        sort_faces(mesh, order, number, starts, scratch);
        sort_vertices(mesh, order, number, starts, scratch);
        mesh->sorted = 1;
    }
    free(scratch);
    free(order);
    free(number);
    free(starts);
    return done;
}

#endif
