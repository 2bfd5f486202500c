/* Flips, splits, removals and moves of vertices in a triangulation of a surface.
 *
 * An edge is changed only after the line that would replace it was followed to its end and found the right vertex
 * there; otherwise the edit is refused. Vectors are set to the unfolded position of that vertex, so nothing drifts.
 */
#ifndef NDF_EDITS_H
#define NDF_EDITS_H

#include "triangulation.h"

#define TOLERANCE 1e-6      /* distance of a line's end from its vertex, over the line's length */
#define MOST_SCALE 1e3      /* of the edges that a line was laid out from, over its own length */
#define LEAST_ALTITUDE 1e-5 /* of a new face, over its longest edge: what keeps lines clear of corners */

/* ---- new edges ---- */

typedef struct {
    int32_t home[2];
    Vector vector[2]; /* from each of its ends */
} Edge;

static void set_edge(Triangulation *mesh, int32_t h, int32_t g, const Edge *edge)
{
    mesh->home[h] = edge->home[0];
    mesh->vector[h] = edge->vector[0];
    mesh->home[g] = edge->home[1];
    mesh->vector[g] = edge->vector[1];
    link_twins(mesh, h, g);
}

/* Turn `vector`, which leaves `point` in face `*face`, anticlockwise by less than pi (a complex factor). Around a
 * corner of the surface the angle is not two pi, so the face that it leaves in has to be found. Returns 0 beyond a
 * border. */
static int turn_vector(const Surface *surface, const Point *point, int32_t *face, Vector *vector, Vector factor)
{
    *vector = times(*vector, factor);
    int own = corner_of(point);
    if (own < 0) return 1;
    int32_t corner = surface->corners[3 * (size_t)point->face + own];
    for (int32_t faces = 0; faces < surface->faces; faces++) {
        int32_t h = 3 * *face;
        while (surface->corners[h] != corner) h++;
        Vector left = minus(surface->corner[previous(h)], surface->corner[h]);
        if (cross(left, *vector) <= 1e-12 * sqrt(inner(left, left) * inner(*vector, *vector))) return 1;
        int32_t side = previous(h);
        if (surface->twins[side] < 0) return 0;
        *vector = times(surface->across[side].turn, *vector);
        *face = surface->twins[side] / 3;
    }
    return 0;
}

/* The edge that leaves `origin` in `face` along `vector`, if it ends at `target`. A vector that was laid out from edges of
 * length `scale` is no more precise than those, if it is much shorter. */
static int find_edge(const Triangulation *mesh, const Point *origin, const Point *target, int32_t face, Vector vector,
                     double scale, Edge *edge)
{
    Vector start;
    Trace trace;
    double size = length(vector);
    scale = smaller(larger(scale, size), MOST_SCALE * size);
    if (!(size > 0) || !place_in(mesh->surface, origin, face, &start)
        || !trace_line(mesh->surface, face, start, vector, &trace)
        || !arrives(mesh->surface, &trace, target, TOLERANCE * scale))
        return 0;
    Vector exact = minus(moved_back(trace.motion, trace.place), start);
    *edge = (Edge){{face, trace.face}, {exact, scaled(times(trace.motion.turn, exact), -1)}};
    return inner(exact, exact) > 0;
}

/* The edge from the start of h to `target`, whose direction is h's times `factor`. */
static int find_edge_beside(const Triangulation *mesh, int32_t h, Vector factor, int32_t target, Edge *edge)
{
    const Point *origin = &mesh->point[mesh->corner[h]];
    int32_t face = mesh->home[h];
    Vector vector = mesh->vector[h];
    return turn_vector(mesh->surface, origin, &face, &vector, factor)
        && find_edge(mesh, origin, &mesh->point[target], face, vector, 0, edge);
}

/* ---- flips ---- */

/* The corner opposite h, in the plane where h runs from 0 along the x axis to `base`. */
static Vector apex_over(const Triangulation *mesh, int32_t h, double base)
{
    return apex(base, length(mesh->vector[previous(h)]), length(mesh->vector[next(h)]));
}

/* The edge that would replace h: its diamond has to be strictly convex, and its ends no neighbours yet. */
static int find_flip(const Triangulation *mesh, int32_t h, Edge *edge)
{
    int32_t g = mesh->twin[h];
    double base = length(mesh->vector[h]);
    Vector a = {0, 0}, b = {base, 0}, c = apex_over(mesh, h, base), d = conjugate(apex(base,
        length(mesh->vector[next(g)]), length(mesh->vector[previous(g)])));
    Vector along = minus(d, c);
    double least = LEAST_ALTITUDE * larger(inner(along, along), base * base);
    if (!(cross(along, minus(b, c)) > least && cross(minus(a, c), along) > least)) return 0;
    int32_t top = mesh->corner[previous(h)], bottom = mesh->corner[previous(g)];
    if (top == bottom || are_neighbours(mesh, top, bottom)) return 0;
    return find_edge_beside(mesh, previous(h), over(along, minus(a, c)), bottom, edge);
}

/* Faces (a, b, c) at h and (b, a, d) at its twin become (a, d, c) and (d, b, c). ca and db stay where they are; ad
 * moves to h and bc to the twin. `edge` runs from c to d. */
static void flip(Triangulation *mesh, int32_t h, const Edge *edge)
{
    int32_t g = mesh->twin[h], bc = next(h), ad = next(g);
    int32_t a = mesh->corner[h], b = mesh->corner[g], c = mesh->corner[previous(h)], d = mesh->corner[previous(g)];
    move_half_edge(mesh, h, ad);
    move_half_edge(mesh, g, bc);
    mesh->corner[bc] = d;
    mesh->corner[ad] = c;
    set_edge(mesh, ad, bc, edge);
    if (mesh->outgoing[a] == ad) mesh->outgoing[a] = h;
    if (mesh->outgoing[b] == bc) mesh->outgoing[b] = g;
    unsettle(mesh, h / 3);
    unsettle(mesh, g / 3);
}

static int flip_if_valid(Triangulation *mesh, int32_t h)
{
    Edge edge;
    if (mesh->twin[h] < 0 || !find_flip(mesh, h, &edge)) return 0;
    flip(mesh, h, &edge);
    return 1;
}

/* ---- splits ---- */

/* Where the middle of an edge lies on the surface. Returns 0 where that cannot be told from a corner of it. */
static int find_middle(const Triangulation *mesh, int32_t start, int32_t home, Vector vector, Point *point)
{
    Vector place;
    Trace trace;
    return place_in(mesh->surface, &mesh->point[start], home, &place)
        && trace_line(mesh->surface, home, place, scaled(vector, 0.5), &trace)
        && point_at(mesh->surface, trace.face, trace.place, point);
}

typedef struct {
    Edge first, second, up, down; /* from the new vertex to the start, the end, and the corners on both sides */
} Split;

/* The four edges at `middle`, a point of h near its middle. */
static int find_split(const Triangulation *mesh, int32_t h, const Point *middle, Split *split)
{
    int32_t g = mesh->twin[h];
    const Point *start = &mesh->point[mesh->corner[h]], *end = &mesh->point[end_of(mesh, h)];
    Edge half;
    if (!find_edge(mesh, start, middle, mesh->home[h], scaled(mesh->vector[h], 0.5), 0, &half)) return 0;
    split->first = (Edge){{half.home[1], half.home[0]}, {half.vector[1], half.vector[0]}};
    double base = length(mesh->vector[h]), part = length(half.vector[0]);
    Vector onward = scaled(half.vector[1], -(base - part) / part);
    if (!find_edge(mesh, middle, end, half.home[1], onward, 0, &split->second)) return 0;
    Vector up = minus(apex_over(mesh, h, base), (Vector){part, 0});
    if (!find_edge(mesh, middle, &mesh->point[mesh->corner[previous(h)]], half.home[1],
                   times(half.vector[1], scaled(up, -1 / part)), base, &split->up))
        return 0;
    if (g < 0) return 1;
    Vector down = minus(conjugate(apex(base, length(mesh->vector[next(g)]), length(mesh->vector[previous(g)]))),
                        (Vector){part, 0});
    return find_edge(mesh, middle, &mesh->point[mesh->corner[previous(g)]], half.home[1],
                     times(half.vector[1], scaled(down, -1 / part)), base, &split->down);
}

/* Put a vertex on h: (a, b, c) becomes (a, m, c) at h and (m, b, c), (b, a, d) becomes (b, m, d) at the twin and
 * (m, a, d). Returns m. */
static int32_t split_edge(Triangulation *mesh, int32_t h, const Split *split, const Point *middle, const double *mapped)
{
    int32_t g = mesh->twin[h], m = new_vertex(mesh), face = 3 * new_face(mesh);
    int32_t a = mesh->corner[h], b = end_of(mesh, h), c = mesh->corner[previous(h)];
    move_half_edge(mesh, face + 1, next(h));
    mesh->corner[face] = mesh->corner[next(h)] = m;
    mesh->corner[face + 2] = c;
    set_edge(mesh, next(h), face + 2, &split->up);
    mesh->outgoing[m] = face;
    mesh->outgoing[b] = mesh->outgoing[b] == next(h) ? face + 1 : mesh->outgoing[b];
    mesh->point[m] = *middle;
    mesh->border[m] = g < 0;
    memcpy(mesh->mapped + 3 * (size_t)m, mapped, 3 * sizeof *mapped);
    int32_t back = NONE, ahead = g;
    if (g >= 0) {
        int32_t other = 3 * new_face(mesh), d = mesh->corner[previous(g)];
        move_half_edge(mesh, other + 1, next(g));
        mesh->corner[other] = mesh->corner[next(g)] = m;
        mesh->corner[other + 2] = d;
        set_edge(mesh, next(g), other + 2, &split->down);
        mesh->outgoing[a] = mesh->outgoing[a] == next(g) ? other + 1 : mesh->outgoing[a];
        back = other;
        mesh->home[back] = split->first.home[0];
        mesh->vector[back] = split->first.vector[0];
        mesh->home[g] = split->second.home[1];
        mesh->vector[g] = split->second.vector[1];
    }
    mesh->home[h] = split->first.home[1];
    mesh->vector[h] = split->first.vector[1];
    mesh->home[face] = split->second.home[0];
    mesh->vector[face] = split->second.vector[0];
    link_twins(mesh, h, back);
    link_twins(mesh, face, ahead);
    unsettle(mesh, h / 3);
    unsettle(mesh, face / 3);
    if (g >= 0) {
        unsettle(mesh, g / 3);
        unsettle(mesh, back / 3);
    }
    return m;
}

/* ---- removal ---- */

/* (v, x, y), (v, y, z), (v, z, x) around v, reached by h = (v, x), become (z, x, y) at h. */
static void merge_three(Triangulation *mesh, int32_t h)
{
    int32_t v = mesh->corner[h], second = turn_left(mesh, h), third = turn_left(mesh, second);
    int32_t x = end_of(mesh, h), y = end_of(mesh, second), z = end_of(mesh, third);
    move_half_edge(mesh, h, next(third));
    move_half_edge(mesh, previous(h), next(second));
    mesh->outgoing[x] = next(h);
    mesh->outgoing[y] = previous(h);
    mesh->outgoing[z] = h;
    unsettle(mesh, h / 3);
    free_face(mesh, second / 3);
    free_face(mesh, third / 3);
    free_vertex(mesh, v);
}

/* (v, x, y), (v, y, z) around v on a straight border, reached by h = (v, x), become (z, x, y) at h. */
static void merge_two(Triangulation *mesh, int32_t h)
{
    int32_t v = mesh->corner[h], second = turn_left(mesh, h), last = previous(second);
    int32_t x = end_of(mesh, h), y = end_of(mesh, second), z = mesh->corner[last];
    double after = length(mesh->vector[h]), before = length(mesh->vector[last]);
    move_half_edge(mesh, h, last);
    mesh->vector[h] = scaled(mesh->vector[h], (before + after) / before);
    move_half_edge(mesh, previous(h), next(second));
    mesh->outgoing[x] = next(h);
    mesh->outgoing[y] = previous(h);
    mesh->outgoing[z] = h;
    unsettle(mesh, h / 3);
    free_face(mesh, second / 3);
    free_vertex(mesh, v);
}

static int valence(const Triangulation *mesh, int32_t v)
{
    int32_t start = first_around(mesh, v), h = start, count = 0;
    do {
        count++;
        h = turn_left(mesh, h);
    } while (h >= 0 && h != start);
    return count; /* of faces */
}

/* Remove a vertex that was put on an edge: flip edges away from it until it can be merged into a face. Returns 0 where
 * that gets stuck; flips that were made stay. */
static int remove_vertex(Triangulation *mesh, int32_t v)
{
    if (corner_of(&mesh->point[v]) >= 0) return 0;
    int least = mesh->border[v] ? 2 : 3;
    for (int faces = valence(mesh, v); faces > least; faces--) {
        int32_t start = first_around(mesh, v), h = start;
        while (!flip_if_valid(mesh, h)) {
            h = turn_left(mesh, h);
            if (h < 0 || h == start) return 0;
        }
    }
    int32_t h = first_around(mesh, v), second = turn_left(mesh, h);
    if (mesh->border[v]) {
        if (are_neighbours(mesh, end_of(mesh, h), mesh->corner[previous(second)])) return 0;
        merge_two(mesh, h);
        return 1;
    }
    int32_t beyond = mesh->twin[next(h)]; /* a face on the same three corners would be doubled */
    if (beyond >= 0 && mesh->corner[previous(beyond)] == end_of(mesh, turn_left(mesh, second))) return 0;
    merge_three(mesh, h);
    return 1;
}

/* ---- moves ---- */

#define MOST_FACES 32 /* around a vertex that is moved */

typedef struct {
    int count;
    int32_t half_edge[MOST_FACES];
    Vector place[MOST_FACES]; /* ends of the half-edges about the vertex, in the plane of `face` */
    int32_t face;
} Star;

/* The neighbours of a vertex that is inside a face or an edge of the surface. Returns 0 for other vertices. */
static int find_star(const Triangulation *mesh, int32_t v, Star *star)
{
    if (mesh->border[v] || corner_of(&mesh->point[v]) >= 0) return 0;
    int32_t start = mesh->outgoing[v], h = start;
    star->face = mesh->point[v].face;
    star->count = 0;
    do {
        if (star->count == MOST_FACES) return 0;
        Vector place = mesh->vector[h];
        if (mesh->home[h] != star->face) {
            int32_t side = 3 * mesh->home[h];
            while (side < 3 * mesh->home[h] + 3
                   && (mesh->surface->twins[side] < 0 || mesh->surface->twins[side] / 3 != star->face))
                side++;
            if (side == 3 * mesh->home[h] + 3) return 0;
            place = times(mesh->surface->across[side].turn, place);
        }
        star->place[star->count] = place;
        star->half_edge[star->count++] = h;
        h = turn_left(mesh, h);
    } while (h != start);
    return 1;
}

/* Whether every face around the vertex keeps its orientation when the vertex moves by `shift`. */
static int star_sees(const Star *star, Vector shift)
{
    for (int i = 0; i < star->count; i++) {
        Vector p = minus(star->place[i], shift), q = minus(star->place[(i + 1) % star->count], shift);
        double side = inner(minus(q, p), minus(q, p));
        if (!(cross(p, q) > LEAST_ALTITUDE * larger(side, larger(inner(p, p), inner(q, q))))) return 0;
    }
    return 1;
}

typedef struct {
    Vector vector; /* in the plane of the star's face */
    Vector turn;   /* from that plane to the one of the face that it leads to */
} Shift;

/* Where a vertex gets that moves by `shift->vector`, and `shift->turn`. */
static int find_shifted(const Triangulation *mesh, int32_t v, const Star *star, Shift *shift, Point *point)
{
    Vector start;
    Trace trace;
    if (!place_in(mesh->surface, &mesh->point[v], star->face, &start)
        || !trace_line(mesh->surface, star->face, start, shift->vector, &trace))
        return 0;
    shift->turn = trace.motion.turn;
    return point_at(mesh->surface, trace.face, trace.place, point);
}

/* Move a vertex to `point`, which the shift leads to, with all its edges. Returns 0, and changes nothing, where an edge
 * cannot be found. */
static int move_vertex(Triangulation *mesh, int32_t v, const Star *star, const Shift *shift, const Point *point,
                       const double *mapped)
{
    Edge edges[MOST_FACES];
    if (!star_sees(star, shift->vector)) return 0;
    for (int i = 0; i < star->count; i++) {
        Vector vector = times(shift->turn, minus(star->place[i], shift->vector));
        const Point *target = &mesh->point[end_of(mesh, star->half_edge[i])];
        if (!find_edge(mesh, point, target, point->face, vector, 0, &edges[i])) return 0;
    }
    for (int i = 0; i < star->count; i++)
        set_edge(mesh, star->half_edge[i], mesh->twin[star->half_edge[i]], &edges[i]);
    mesh->point[v] = *point;
    memcpy(mesh->mapped + 3 * (size_t)v, mapped, 3 * sizeof *mapped);
    for (int i = 0; i < star->count; i++) unsettle(mesh, star->half_edge[i] / 3);
    return 1;
}

#endif
