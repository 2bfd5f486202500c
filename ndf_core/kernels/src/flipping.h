/* What to flip: for a lower ODT energy (Sec. 3.4), for the Delaunay condition, or to unfold. */
#ifndef NDF_FLIPPING_H
#define NDF_FLIPPING_H

#include "mapped.h"

#define FOLD -0.5       /* product of the unit normals of faces that count as folded over each other */
#define CREASE 0.5      /* and of faces with a crease between them: 60 degrees */
#define LEAST_GAIN 0.05 /* by which unfolding has to raise the smallest product around an edge */
#define STILL_HELD -2.0 /* sum of the opposite cotangents down to which a crease is kept */

/* Whether the sharpest edge of the diamond around h does not get sharper, or gets blunter by `gain`: `left` and `right`
 * are its faces (a, b, c) and (b, a, d), `first` and `second` (a, d, c) and (d, b, c). */
static int keeps_smooth(const Triangulation *mesh, int32_t h, const Shape *left, const Shape *right, const Shape *first,
                        const Shape *second, double gain)
{
    int32_t g = mesh->twin[h];
    const int32_t sides[4] = {next(h), previous(h), next(g), previous(g)}; /* bc, ca, ad, db */
    const Shape *before[4] = {left, left, right, right}, *after[4] = {second, first, first, second};
    double sharpest = bend(left, right), sharper = bend(first, second);
    for (int i = 0; i < 4; i++) {
        int32_t t = mesh->twin[sides[i]];
        if (t < 0) continue;
        Shape beyond = shape_of(mapped_at(mesh, mesh->corner[t]), mapped_at(mesh, end_of(mesh, t)),
                                mapped_at(mesh, mesh->corner[previous(t)]));
        sharpest = smaller(sharpest, bend(before[i], &beyond));
        sharper = smaller(sharper, bend(after[i], &beyond));
    }
    return gain > 0 ? sharper >= sharpest + gain : sharper >= smaller(sharpest, CREASE);
}

/* Share of the inner edges whose opposite angles in space add up to pi at most. */
static double delaunay_share(const Triangulation *mesh)
{
    int32_t edges = 0, delaunay = 0;
    for (int32_t h = 0; h < 3 * mesh->faces; h++) {
        int32_t g = mesh->twin[h];
        if (!is_edge(mesh, h) || g < 0) continue;
        const double *a = mapped_at(mesh, mesh->corner[h]), *b = mapped_at(mesh, mesh->corner[g]);
        const double *c = mapped_at(mesh, mesh->corner[previous(h)]), *d = mapped_at(mesh, mesh->corner[previous(g)]);
        double along = squared_distance(a, b);
        double at_c = squared_distance(c, a) + squared_distance(c, b) - along;
        double at_d = squared_distance(d, a) + squared_distance(d, b) - along;
        edges++;
        delaunay += (at_c >= 0 && at_d >= 0)
            || at_c * shape_of(b, a, d).area + at_d * shape_of(a, b, c).area >= 0;
    }
    return edges ? (double)delaunay / edges : 1;
}

static int has_long_edge(const Triangulation *mesh, int32_t face, double limit)
{
    for (int i = 0; i < 3; i++)
        if (mapped_square(mesh, 3 * face + i) > limit * limit) return 1;
    return 0;
}

/* Whether a flip makes h Delaunay on the surface, wherever the map takes it, beside a face with a long edge. */
static int spreads(const Triangulation *mesh, int32_t h, double limit)
{
    int32_t g = mesh->twin[h];
    if (!has_long_edge(mesh, h / 3, limit) && !has_long_edge(mesh, g / 3, limit)) return 0;
    double base = length(mesh->vector[h]);
    Vector b = {base, 0}, c = apex_over(mesh, h, base);
    Vector d = conjugate(apex(base, length(mesh->vector[next(g)]), length(mesh->vector[previous(g)])));
    double at_c = inner(c, minus(c, b)), at_d = inner(d, minus(d, b)); /* over base times height: cotangents */
    return at_c * -d.y + at_d * c.y < -1e-9 * base * base * base;
}

/* Whether faces (a, b, c) and (b, a, d) lie folded over each other. */
static int are_folded(const double *a, const double *b, const double *c, const double *d)
{
    Shape left = shape_of(a, b, c), right = shape_of(b, a, d);
    return bend(&left, &right) < FOLD;
}

static int gets_better(const Triangulation *mesh, int32_t h, const Aim *aim)
{
    int32_t g = mesh->twin[h];
    Criterion criterion = aim->criterion;
    if (criterion == SPREAD) return spreads(mesh, h, aim->limit);
    const double *a = mapped_at(mesh, mesh->corner[h]), *b = mapped_at(mesh, mesh->corner[g]);
    const double *c = mapped_at(mesh, mesh->corner[previous(h)]), *d = mapped_at(mesh, mesh->corner[previous(g)]);
    if (criterion == UNFOLD && !are_folded(a, b, c, d)) return 0;
    double along = squared_distance(a, b);
    double at_c = squared_distance(c, a) + squared_distance(c, b) - along; /* positive where the angle is acute */
    double at_d = squared_distance(d, a) + squared_distance(d, b) - along;
    if (criterion != UNFOLD && at_c >= 0 && at_d >= 0) return 0;
    double across = squared_distance(c, d);
    if (across > aim->limit * aim->limit && across > along) return 0;
    Shape left = shape_of(a, b, c), right = shape_of(b, a, d);
    if (criterion == DELAUNAY && at_c * right.area + at_d * left.area >= -1e-9 * left.area * right.area) return 0;
    /* Creases stay, since a flip would cut them off, unless their faces are thin. */
    if (criterion != UNFOLD && bend(&left, &right) < CREASE && at_c / left.area + at_d / right.area > 2 * STILL_HELD) return 0;
    Shape first = shape_of(a, d, c), second = shape_of(d, b, c);
    if (criterion == ODT) {
        double before = left.area * left.squares + right.area * right.squares;
        if (first.area * first.squares + second.area * second.squares >= before * (1 - 1e-9)) return 0;
    }
    if (!(first.area > 0 && second.area > 0)) return 0;
    return keeps_smooth(mesh, h, &left, &right, &first, &second, criterion == UNFOLD ? LEAST_GAIN : 0);
}

/* Whether a flip of h moves the surface by more than the tolerance. */
static int is_bent(const Triangulation *mesh, int32_t h, double tolerance)
{
    if (!(tolerance < INFINITY)) return 0;
    double normal[3], middle[3], size = normal_across(mesh, h, normal);
    const double *c = mapped_at(mesh, mesh->corner[previous(h)]);
    const double *d = mapped_at(mesh, mesh->corner[previous(mesh->twin[h])]);
    for (int k = 0; k < 3; k++) middle[k] = 0.5 * (c[k] + d[k]);
    return height_over(mesh, mesh->corner[h], end_of(mesh, h), middle, normal, size) > tolerance;
}

/* ---- passes ---- */

#define WAITING 1 /* on the stack */
#define HELD 2    /* better flipped, but that would move the surface */
#define LISTED 4  /* among those that were held at some time */

typedef struct {
    uint8_t *state;        /* by half-edge */
    int32_t *stack, count; /* those that wait; from its end backwards, those listed */
    int32_t size, listed;
} Queue;

static void queue_free(Queue *queue)
{
    free(queue->state);
    free(queue->stack);
}

static int queue_create(Queue *queue, int32_t half_edges)
{
    *queue = (Queue){calloc((size_t)half_edges + 1, 1), malloc(((size_t)half_edges + 1) * sizeof *queue->stack), 0,
                     half_edges, 0};
    if (queue->state && queue->stack) return 1;
    queue_free(queue);
    return 0;
}

static void queue_add(const Triangulation *mesh, Queue *queue, int32_t h)
{
    int32_t g = mesh->twin[h];
    if (g < 0 || ((queue->state[h] | queue->state[g]) & WAITING)) return;
    queue->state[h] = (queue->state[h] & LISTED) | WAITING;
    queue->stack[queue->count++] = h;
}

static void queue_hold(Queue *queue, int32_t h)
{
    if (!(queue->state[h] & LISTED)) queue->stack[queue->size - ++queue->listed] = h;
    queue->state[h] = LISTED | HELD;
}

/* Flip h, and look at the four edges around it again. */
static int flip_in(Triangulation *mesh, Queue *queue, int32_t h)
{
    int32_t g = mesh->twin[h];
    if (!flip_if_valid(mesh, h)) return 0;
    const int32_t around[4] = {h, previous(h), g, previous(g)};
    for (int i = 0; i < 4; i++) queue_add(mesh, queue, around[i]);
    return 1;
}

/* Flip the edges that wait while that makes the mapped mesh better and moves it by little. Edges whose flips would move
 * it by more are held. Returns the number of flips. */
static int64_t flip_waiting(Triangulation *mesh, const Aim *aim, Queue *queue)
{
    int64_t flips = 0, most = 30 * (int64_t)mesh->faces;
    while (queue->count && flips < most) {
        int32_t h = queue->stack[--queue->count];
        queue->state[h] &= LISTED;
        settle(mesh, h);
        if (!gets_better(mesh, h, aim)) continue;
        if (!is_bent(mesh, h, aim->tolerance)) {
            flips += flip_in(mesh, queue, h);
        } else if (!(queue->state[mesh->twin[h]] & HELD)) {
            queue_hold(queue, h);
        }
    }
    return flips;
}

/* For the edges held, their middles and those of the edges that would replace them. Returns 0 without memory. */
static int find_middles(Triangulation *mesh, const Queue *queue, Places *places)
{
    places->count = 0;
    for (int32_t i = 1; i <= queue->listed; i++) {
        int32_t h = queue->stack[queue->size - i];
        Edge edge;
        Point old, new;
        if (!(queue->state[h] & HELD) || !gets_better(mesh, h, &places->aim) || !find_flip(mesh, h, &edge)
            || !find_middle(mesh, mesh->corner[h], mesh->home[h], mesh->vector[h], &old)
            || !find_middle(mesh, mesh->corner[previous(h)], edge.home[0], edge.vector[0], &new))
            continue;
        mesh->settled[h] = 0;
        if (!places_add(places, h, &old) || !places_add(places, h, &new)) return 0;
    }
    return 1;
}

/* Flip what can be flipped at once; places get the middles for the rest. Returns the number of flips, -1 without
 * memory. */
static int64_t flip_edges(Triangulation *mesh, const Aim *aim, Places *places)
{
    Queue queue;
    if (!queue_create(&queue, 3 * mesh->faces)) return -1;
    if (aim->criterion == SPREAD || mesh->settled_for != (int)aim->criterion || mesh->settled_within != aim->tolerance)
        memset(mesh->settled, 0, 3 * (size_t)mesh->faces);
    mesh->settled_for = (int)aim->criterion;
    mesh->settled_within = aim->tolerance;
    for (int32_t h = 3 * mesh->faces - 1; h >= 0; h--)
        if (!mesh->settled[h] && is_edge(mesh, h)) queue_add(mesh, &queue, h);
    int64_t flips = flip_waiting(mesh, aim, &queue);
    places->aim = *aim;
    if (!find_middles(mesh, &queue, places)) flips = -1;
    queue_free(&queue);
    return flips;
}

/* Flip the edges held whose replacement is about as close to the surface, and what can be flipped then; places get the
 * middles for the rest, but for edges that were held before. `mapped` has the middles on the surface. Returns the number
 * of flips, -1 without memory. */
static int64_t flip_held_edges(Triangulation *mesh, Places *places, const double *mapped)
{
    Queue queue;
    uint8_t *changed = calloc((size_t)mesh->faces + 1, 1);
    int64_t flips = 0;
    if (!changed || !queue_create(&queue, 3 * mesh->faces)) {
        free(changed);
        return -1;
    }
    for (int32_t i = 0; i + 1 < places->count; i += 2, mapped += 6) {
        int32_t h = places->item[i], g = mesh->twin[h];
        if (changed[h / 3] || changed[g / 3]) continue;
        settle(mesh, h);
        if (!gets_better(mesh, h, &places->aim)) continue;
        double normal[3], size = normal_across(mesh, h, normal);
        double before = height_over(mesh, mesh->corner[h], mesh->corner[g], mapped, normal, size);
        double after = height_over(mesh, mesh->corner[previous(h)], mesh->corner[previous(g)], mapped + 3, normal, size);
        if (after > before + places->aim.tolerance || !flip_in(mesh, &queue, h)) continue;
        changed[h / 3] = changed[g / 3] = 1;
        flips++;
    }
    flips += flip_waiting(mesh, &places->aim, &queue);
    if (!find_middles(mesh, &queue, places)) flips = -1;
    queue_free(&queue);
    free(changed);
    return flips;
}

#endif
