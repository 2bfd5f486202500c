/* Lengths of edges along the mapped surface, from one more point of it on each. */
#ifndef NDF_MEASURING_H
#define NDF_MEASURING_H

#include "flipping.h"

#define EXCESS (10.0 / 3)     /* 8 / 3 is right for arcs, 4 on average for a kink anywhere on the edge: fields have both */
#define MOST_BENT 1.15       /* arc over chord beyond which three points do not tell the arc */
#define LEAST_SLACK_KEPT 0.5 /* of a face: its two shorter sides less the longest, over that of the chords */

/* Middles of the edges, each by the larger of its half-edges, that are in faces `first` to `last`, without it; an edge
 * without a middle gets its first end. Returns 0 without memory. */
static int find_edge_middles(const Triangulation *mesh, int32_t first, int32_t last, Places *places)
{
    places->count = 0;
    for (int32_t h = 3 * first; h < 3 * last; h++) {
        if (!is_edge(mesh, h)) continue;
        Point middle = mesh->point[mesh->corner[h]];
        find_middle(mesh, mesh->corner[h], mesh->home[h], mesh->vector[h], &middle);
        if (!places_add(places, h, &middle)) return 0;
    }
    return 1;
}

/* Length of an edge over `middle`, from how high that is above the chord. Only the height counts: the map takes straight
 * lines to lines that turn within the surface, and those are detours. */
static double arc_length(const Triangulation *mesh, int32_t h, const double *middle)
{
    double normal[3], size = normal_across(mesh, h, normal), chord = sqrt(mapped_square(mesh, h));
    double height = height_over(mesh, mesh->corner[h], end_of(mesh, h), middle, normal, size);
    return smaller(chord + EXCESS * height * height / larger(chord, 1e-300), MOST_BENT * chord);
}

/* Its shorter sides less the longest. */
static double slack(const double *sides)
{
    return sides[0] + sides[1] + sides[2] - 2 * larger(sides[0], larger(sides[1], sides[2]));
}

/* Give edges of faces that would be too thin their chords, until all faces are triangles about as before. */
static void keep_triangles(const Triangulation *mesh, double *lengths)
{
    int changed = 1;
    while (changed) {
        changed = 0;
        for (int32_t h = 0; h < 3 * mesh->faces; h += 3) {
            double chords[3];
            for (int i = 0; i < 3; i++) chords[i] = sqrt(mapped_square(mesh, h + i));
            if (slack(lengths + h) >= LEAST_SLACK_KEPT * slack(chords)) continue;
            for (int i = 0; i < 3; i++) {
                changed |= lengths[h + i] != chords[i];
                lengths[h + i] = chords[i];
                if (mesh->twin[h + i] >= 0) lengths[mesh->twin[h + i]] = chords[i];
            }
        }
    }
}

/* Lengths along the surface of the half-edges whose middles were found; `mapped` has these. No slot may be free. */
static void measure_edges(const Triangulation *mesh, const Places *places, const double *mapped, double *lengths)
{
    for (int32_t i = 0; i < places->count; i++) {
        int32_t h = places->item[i], g = mesh->twin[h];
        lengths[h] = arc_length(mesh, h, mapped + 3 * (size_t)i);
        if (g >= 0) lengths[g] = lengths[h];
    }
}

#endif
