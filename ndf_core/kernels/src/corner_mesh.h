/* A manifold triangle mesh as corners: half-edge h runs from corner[h] to corner[next(h)] in face h / 3.
 * Only collapses and flips change it, so next and previous stay implied by the index. */
#ifndef NDF_CORNER_MESH_H
#define NDF_CORNER_MESH_H

#include <stdint.h>
#include <stdlib.h>

typedef struct {
    int32_t faces, vertices;
    int32_t *corner;   /* 3 per face: vertex, -1 in a removed face */
    int32_t *opposite; /* 3 per face: the other half-edge of the edge, -1 on the boundary */
    int32_t *outgoing; /* per vertex: a half-edge that leaves it (on the boundary the first one), -1 if removed */
} CornerMesh;

static inline int32_t next(int32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
static inline int32_t previous(int32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

/* Anticlockwise turn about the start of h; -1 past the boundary. */
static inline int32_t turn(const CornerMesh *mesh, int32_t h) { return mesh->opposite[previous(h)]; }
static inline int32_t end_of(const CornerMesh *mesh, int32_t h) { return mesh->corner[next(h)]; }
static inline int on_boundary(const CornerMesh *mesh, int32_t v) { return mesh->opposite[mesh->outgoing[v]] < 0; }

/* Let v leave by h, or by the first half-edge of its fan if v is on the boundary. */
static inline void set_outgoing(CornerMesh *mesh, int32_t v, int32_t h)
{
    int32_t start = h;
    while (mesh->opposite[h] >= 0) {
        h = next(mesh->opposite[h]);
        if (h == start) break;
    }
    mesh->outgoing[v] = h;
}

static inline void link_edges(CornerMesh *mesh, int32_t h, int32_t g)
{
    if (h >= 0) mesh->opposite[h] = g;
    if (g >= 0) mesh->opposite[g] = h;
}

static void corner_mesh_destroy(CornerMesh *mesh)
{
    free(mesh->corner);
    free(mesh->opposite);
    free(mesh->outgoing);
}

/* Pair the half-edges by a hash of their end points. Returns -1 where an edge has more than two faces, or two that run
 * through it in the same direction. */
static int pair_half_edges(CornerMesh *mesh)
{
    size_t half_edges = 3 * (size_t)mesh->faces, size = 4;
    while (size < 2 * half_edges) size *= 2;
    int32_t *slot = malloc(size * sizeof *slot);
    if (!slot) return -2;
    for (size_t i = 0; i < size; i++) slot[i] = -1;
    int result = 0;
    for (int32_t h = 0; h < (int32_t)half_edges && !result; h++) {
        uint32_t a = (uint32_t)mesh->corner[h], b = (uint32_t)end_of(mesh, h), low = a < b ? a : b, high = a < b ? b : a;
        uint64_t place = ((((uint64_t)low << 32) | high) * 0x9E3779B97F4A7C15u) >> 20 & (size - 1);
        for (;; place = (place + 1) & (size - 1)) {
            int32_t g = slot[place];
            if (g < 0) {
                slot[place] = h;
                break;
            }
            uint32_t c = (uint32_t)mesh->corner[g], d = (uint32_t)end_of(mesh, g);
            if (!((a == c && b == d) || (a == d && b == c))) continue;
            if (mesh->opposite[g] >= 0 || a == c) result = -1;
            else link_edges(mesh, h, g);
            break;
        }
    }
    free(slot);
    return result;
}

/* Build from faces whose indices are in range. Returns 0; -1 if it is not an oriented manifold, -2 without memory. */
static int corner_mesh_create(CornerMesh *mesh, const int32_t *faces, size_t face_count, size_t vertex_count)
{
    size_t half_edges = 3 * face_count;
    mesh->faces = (int32_t)face_count;
    mesh->vertices = (int32_t)vertex_count;
    mesh->corner = malloc((half_edges + 1) * sizeof *mesh->corner);
    mesh->opposite = malloc((half_edges + 1) * sizeof *mesh->opposite);
    mesh->outgoing = malloc((vertex_count + 1) * sizeof *mesh->outgoing);
    int32_t *corners_of = calloc(vertex_count + 1, sizeof *corners_of);
    int result = mesh->corner && mesh->opposite && mesh->outgoing && corners_of ? 0 : -2;
    if (!result) {
        for (size_t v = 0; v < vertex_count; v++) mesh->outgoing[v] = -1;
        for (size_t h = 0; h < half_edges; h++) {
            mesh->corner[h] = faces[h];
            mesh->opposite[h] = -1;
            corners_of[faces[h]]++;
        }
        result = pair_half_edges(mesh);
    }
    for (size_t h = 0; h < half_edges && !result; h++) {
        int32_t v = mesh->corner[h];
        if (v == end_of(mesh, (int32_t)h)) result = -1;
        else if (mesh->outgoing[v] < 0) set_outgoing(mesh, v, (int32_t)h);
    }
    for (size_t v = 0; v < vertex_count && !result; v++) {
        int32_t start = mesh->outgoing[v], h = start, fan = 0;
        if (start < 0) continue;
        do {
            fan++;
            h = turn(mesh, h);
        } while (h >= 0 && h != start);
        if (fan != corners_of[v]) result = -1;
    }
    free(corners_of);
    return result;
}

/* Collapse h = (a, b) into a, which must satisfy the link condition. */
static void collapse_edge(CornerMesh *mesh, int32_t h)
{
    int32_t a = mesh->corner[h], b = end_of(mesh, h), sides[2] = {h, mesh->opposite[h]};
    int32_t start = mesh->outgoing[b], g = start;
    do {
        mesh->corner[g] = a;
        g = turn(mesh, g);
    } while (g >= 0 && g != start);
    mesh->outgoing[b] = -1;
    int32_t survivor = -1, apex[2] = {-1, -1}, apex_out[2] = {-1, -1};
    for (int side = 0; side < 2 && sides[side] >= 0; side++) {
        int32_t n = next(sides[side]), p = previous(sides[side]), left = mesh->opposite[p], right = mesh->opposite[n];
        apex[side] = mesh->corner[p];
        apex_out[side] = right >= 0 ? right : next(left);
        if (survivor < 0) survivor = left >= 0 ? left : next(right);
        link_edges(mesh, left, right);
        int32_t face = sides[side] / 3;
        mesh->corner[3 * face] = mesh->corner[3 * face + 1] = mesh->corner[3 * face + 2] = -1;
    }
    for (int side = 0; side < 2; side++)
        if (apex[side] >= 0) set_outgoing(mesh, apex[side], apex_out[side]);
    set_outgoing(mesh, a, survivor);
}

/* Turn the interior edge h = (a, b) of the triangles (a, b, c) and (b, a, d) into (c, d), which must not exist yet. */
static void flip_edge(CornerMesh *mesh, int32_t h)
{
    int32_t g = mesh->opposite[h], n = next(h), p = previous(h), gn = next(g), gp = previous(g);
    int32_t beyond_p = mesh->opposite[p], beyond_gp = mesh->opposite[gp];
    int32_t a = mesh->corner[h], b = mesh->corner[g], c = mesh->corner[p], d = mesh->corner[gp];
    mesh->corner[h] = d;
    mesh->corner[g] = c;
    mesh->opposite[h] = mesh->opposite[g] = -1;
    link_edges(mesh, h, beyond_gp);
    link_edges(mesh, g, beyond_p);
    link_edges(mesh, p, gp);
    set_outgoing(mesh, a, gn);
    set_outgoing(mesh, b, n);
    set_outgoing(mesh, c, p);
    set_outgoing(mesh, d, gp);
}

#endif
