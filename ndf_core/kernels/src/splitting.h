/* What to split and what to remove: edges that are mapped too long or too short (Sec. 3.4). */
#ifndef NDF_SPLITTING_H
#define NDF_SPLITTING_H

#include "flipping.h"

/* ---- long edges ---- */

#define THINNEST 0.25 /* altitude over longest edge, on the surface */
#define SHORTEST 1e-6 /* length of an edge on the surface, over that of a base edge, below which it is not split */

/* The longest edge of a face that is thinner than THINNEST across it; NONE where it is not thin. */
static int32_t edge_along(const Triangulation *mesh, int32_t face)
{
    double sides[3];
    for (int i = 0; i < 3; i++) sides[i] = length(mesh->vector[3 * face + i]);
    int i = sides[0] >= sides[1] && sides[0] >= sides[2] ? 0 : sides[1] >= sides[2] ? 1 : 2;
    return apex(sides[i], sides[(i + 2) % 3], sides[(i + 1) % 3]).y < THINNEST * sides[i] ? 3 * face + i : NONE;
}

/* In a thin face with an edge to be split, split the edge along it too; so in the face beyond, and so on. */
static void mark_along(const Triangulation *mesh, uint8_t *marks, int32_t face)
{
    while (1) {
        int32_t h = edge_along(mesh, face);
        if (h < 0 || marks[h]) return;
        marks[h] = 1;
        if (mesh->twin[h] < 0) return;
        marks[mesh->twin[h]] = 1;
        face = mesh->twin[h] / 3;
    }
}

/* Middles of the edges that are longer than `limit`, and with `along` also of the edges along thin faces beside them.
 * The ends of an edge may meet where the surface between them is far away, and then all points near the edge are far
 * from them: the faces beside it would be split for ever, into ever thinner ones. With `along` (Rivara's longest-edge
 * propagation, for thin faces) every split takes a fixed share of a face's area or of its length, so splitting ends
 * once the faces are small enough for a Lipschitz map. Returns 0 without memory; `refused` counts edges without a
 * middle and those that are too short on the surface already. */
static int find_long_edges(const Triangulation *mesh, double limit, int along, Places *places, int32_t *refused)
{
    uint8_t *marks = calloc(3 * (size_t)mesh->faces + 1, 1);
    int done = marks != NULL;
    places->count = *refused = 0;
    for (int32_t h = 0; done && h < 3 * mesh->faces; h++)
        if (is_edge(mesh, h) && mapped_square(mesh, h) > limit * limit) {
            marks[h] = 1;
            if (mesh->twin[h] >= 0) marks[mesh->twin[h]] = 1;
        }
    for (int32_t h = 0; done && along && h < 3 * mesh->faces; h += 3)
        if (marks[h] || marks[h + 1] || marks[h + 2]) mark_along(mesh, marks, h / 3);
    for (int32_t h = 0; done && h < 3 * mesh->faces; h++) {
        Point middle;
        if (!marks[h] || !is_edge(mesh, h)) continue;
        if (length(mesh->vector[h]) < SHORTEST * mesh->surface->size
            || !find_middle(mesh, mesh->corner[h], mesh->home[h], mesh->vector[h], &middle))
            ++*refused;
        else
            done = places_add(places, h, &middle);
    }
    free(marks);
    return done;
}

/* The longest edge of the face of h, by its length in space. */
static int32_t longest_edge(const Triangulation *mesh, int32_t h)
{
    int32_t longest = h;
    for (int32_t other = next(h); other != h; other = next(other))
        if (mapped_square(mesh, other) > mapped_square(mesh, longest)) longest = other;
    return longest;
}

/* Middles of the longest edges of faces that lie folded over a neighbour. Returns 0 without memory. */
static int find_folded_edges(const Triangulation *mesh, Places *places)
{
    uint8_t *marks = calloc(3 * (size_t)mesh->faces + 1, 1);
    int done = marks != NULL;
    places->count = 0;
    for (int32_t h = 0; done && h < 3 * mesh->faces; h++) {
        int32_t g = mesh->twin[h];
        if (mesh->corner[h] < 0 || g < 0
            || !are_folded(mapped_at(mesh, mesh->corner[h]), mapped_at(mesh, mesh->corner[g]),
                           mapped_at(mesh, mesh->corner[previous(h)]), mapped_at(mesh, mesh->corner[previous(g)])))
            continue;
        int32_t longest = longest_edge(mesh, h);
        Point middle;
        if (marks[longest]
            || !find_middle(mesh, mesh->corner[longest], mesh->home[longest], mesh->vector[longest], &middle))
            continue;
        marks[longest] = 1;
        if (mesh->twin[longest] >= 0) marks[mesh->twin[longest]] = 1;
        done = places_add(places, longest, &middle);
    }
    free(marks);
    return done;
}

/* Split at the places found; `mapped` has their positions. Returns how many splits were refused, -1 without memory. */
static int64_t split_long_edges(Triangulation *mesh, Places *places, const double *mapped)
{
    int32_t refused = 0;
    if (!triangulation_reserve(mesh, places->count)) return -1;
    for (int32_t i = 0; i < places->count; i++) {
        Split split;
        if (find_split(mesh, places->item[i], &places->point[i], &split))
            split_edge(mesh, places->item[i], &split, &places->point[i], mapped + 3 * (size_t)i);
        else
            refused++;
    }
    places->count = 0;
    return refused;
}

/* ---- short edges ---- */

/* Remove a vertex of each edge shorter than `limit`. Returns their number. */
static int32_t remove_short_edges(Triangulation *mesh, double limit)
{
    int32_t removed = 0;
    for (int32_t h = 0; h < 3 * mesh->faces; h++) {
        if (!is_edge(mesh, h) || mapped_square(mesh, h) >= limit * limit) continue;
        int32_t a = mesh->corner[h], b = end_of(mesh, h);
        removed += remove_vertex(mesh, a > b ? a : b) || remove_vertex(mesh, a > b ? b : a);
    }
    return removed;
}

#endif
