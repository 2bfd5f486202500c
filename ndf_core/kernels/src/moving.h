/* What to move: vertices to the centre of the faces around them. */
#ifndef NDF_MOVING_H
#define NDF_MOVING_H

#include "flipping.h"

#define SHARPER 10    /* of the two sharpest edges at a vertex over the third: then they are a crease */
#define STRAIGHT 0.02 /* distance of a vertex on a crease from its neighbours' line, over their distance */

typedef struct {
    int sharp;       /* edges that bend by more than `CREASE` allows */
    double tilt[3];  /* the largest of one minus the products of normals: half the squares of small angles */
    Vector place[2]; /* ends of the first two */
} Creases;

static void creases_add(Creases *creases, double tilt, Vector place)
{
    double *most = creases->tilt;
    creases->sharp += tilt > 1 - CREASE;
    if (tilt > most[0]) {
        most[2] = most[1];
        most[1] = most[0];
        most[0] = tilt;
        creases->place[1] = creases->place[0];
        creases->place[0] = place;
    } else if (tilt > most[1]) {
        most[2] = most[1];
        most[1] = tilt;
        creases->place[1] = place;
    } else {
        most[2] = larger(most[2], tilt);
    }
}

/* Whether a vertex is on a crease: no more than its two sharpest edges are sharp, and much sharper than the others. A
 * flip of such an edge, in equilateral faces, would move the surface by sqrt(3/8 tilt) of its length. */
static int has_crease(const Creases *creases, double tolerance)
{
    return creases->sharp == 2
        || (creases->sharp == 0 && creases->tilt[1] > SHARPER * creases->tilt[2]
            && 0.375 * creases->tilt[1] * inner(creases->place[1], creases->place[1]) > tolerance * tolerance);
}

/* The shift that takes a vertex to the mean of the faces around it, weighted with their mapped areas: where the map is
 * affine, the same as that mean in the mapped mesh. On a crease, to the middle between its neighbours there, if these
 * lie on a line with it; a crease may be left where it is a fold. Returns 0 for ends, corners and turns of creases. */
static int find_shift(const Triangulation *mesh, int32_t v, const Star *star, int folded, double tolerance,
                      Vector *shift)
{
    Shape shapes[MOST_FACES];
    Vector sum = {0, 0};
    Creases creases = {0};
    double total = 0;
    for (int i = 0; i < star->count; i++) {
        int k = i + 1 < star->count ? i + 1 : 0;
        shapes[i] = shape_of(mapped_at(mesh, v), mapped_at(mesh, end_of(mesh, star->half_edge[i])),
                             mapped_at(mesh, end_of(mesh, star->half_edge[k])));
        sum = plus(sum, scaled(plus(star->place[i], star->place[k]), shapes[i].area));
        total += shapes[i].area;
    }
    for (int i = 0; i < star->count; i++)
        creases_add(&creases, 1 - bend(&shapes[i], &shapes[i > 0 ? i - 1 : star->count - 1]), star->place[i]);
    *shift = total > 0 ? scaled(sum, 1 / (3 * total)) : sum;
    int held = has_crease(&creases, tolerance);
    if (folded || (!held && creases.sharp == 0)) return total > 0;
    Vector first = creases.place[0], second = creases.place[1], line = minus(second, first);
    if (!held || !(fabs(cross(first, second)) < STRAIGHT * inner(line, line))) return 0;
    *shift = scaled(line, inner(line, scaled(plus(first, second), 0.5)) / inner(line, line));
    return 1;
}

/* Mark the four vertices around every edge whose faces lie folded over each other. */
static void mark_folded(const Triangulation *mesh, uint8_t *marks)
{
    for (int32_t h = 0; h < 3 * mesh->faces; h++) {
        int32_t g = mesh->twin[h];
        if (!is_edge(mesh, h) || g < 0) continue;
        int32_t quad[4] = {mesh->corner[h], mesh->corner[g], mesh->corner[previous(h)], mesh->corner[previous(g)]};
        if (are_folded(mapped_at(mesh, quad[0]), mapped_at(mesh, quad[1]), mapped_at(mesh, quad[2]),
                       mapped_at(mesh, quad[3])))
            for (int i = 0; i < 4; i++) marks[quad[i]] = 1;
    }
}

static int places_add_move(Places *places, int32_t v, const Point *point, Shift shift)
{
    if (!places_add(places, v, point)) return 0;
    if (places->shift_capacity < places->capacity) {
        if (!resize((void **)&places->shift, (size_t)places->capacity, sizeof *places->shift)) return 0;
        places->shift_capacity = places->capacity;
    }
    places->shift[places->count - 1] = shift;
    return 1;
}

/* Places for the vertices that may move, all or those beside folds. Returns 0 without memory. */
static int find_moves(const Triangulation *mesh, int folded, double limit, double tolerance, Places *places)
{
    uint8_t *marks = calloc((size_t)mesh->vertices + 1, 1);
    int done = marks != NULL;
    places->count = 0;
    places->aim = (Aim){UNFOLD, limit, tolerance};
    if (done && folded) mark_folded(mesh, marks);
    for (int32_t v = 0; done && v < mesh->vertices; v++) {
        Star star;
        Shift shift;
        Point point;
        if (marks[v] != folded || mesh->outgoing[v] < 0 || !find_star(mesh, v, &star)) continue;
        if (find_shift(mesh, v, &star, folded, tolerance, &shift.vector) && star_sees(&star, shift.vector)
            && find_shifted(mesh, v, &star, &shift, &point))
            done = places_add_move(places, v, &point, shift);
    }
    free(marks);
    return done;
}

typedef struct {
    double quality; /* smallest area over squared edges of the faces around a vertex */
    double bend;    /* smallest product of unit normals over all edges of these faces */
} StarShape;

static StarShape star_shape(const Triangulation *mesh, const Star *star, const double *position, const Shape *beyond)
{
    StarShape result = {INFINITY, 1};
    Shape before = {{0, 0, 0}, 0, 0}, first = before;
    for (int i = 0; i <= star->count; i++) {
        Shape shape = first;
        if (i < star->count) {
            int k = i + 1 < star->count ? i + 1 : 0;
            shape = shape_of(position, mapped_at(mesh, end_of(mesh, star->half_edge[i])),
                             mapped_at(mesh, end_of(mesh, star->half_edge[k])));
            result.quality = smaller(result.quality, shape.area / larger(shape.squares, 1e-300));
            if (beyond[i].area >= 0) result.bend = smaller(result.bend, bend(&shape, &beyond[i]));
        }
        if (i > 0) result.bend = smaller(result.bend, bend(&shape, &before));
        if (i == 0) first = shape;
        before = shape;
    }
    return result;
}

/* Distance of `point` from the plane of the mapped face with `position` as the star's vertex into which `shift` leads.
 * `place` has the ends of the star's edges about the vertex. */
static double distance_from_star(const Triangulation *mesh, const Star *star, const double *position, Vector origin,
                                 Vector shift, const double *point)
{
    for (int i = 0; i < star->count; i++) {
        int k = i + 1 < star->count ? i + 1 : 0;
        if (cross(minus(star->place[i], origin), shift) < 0 || cross(shift, minus(star->place[k], origin)) < 0) continue;
        Shape shape = shape_of(position, mapped_at(mesh, end_of(mesh, star->half_edge[i])),
                               mapped_at(mesh, end_of(mesh, star->half_edge[k])));
        double height = 0;
        for (int c = 0; c < 3; c++) height += shape.normal[c] * (point[c] - position[c]);
        return fabs(height) / larger(shape.area, 1e-300);
    }
    return 0;
}

/* Whether the surface at the old place of a vertex would be farther from the mesh than it is at the new one by now. */
static int strays(const Triangulation *mesh, int32_t v, const Star *star, const double *position, Vector shift,
                  double tolerance)
{
    const double *old = mapped_at(mesh, v);
    double before = distance_from_star(mesh, star, old, (Vector){0, 0}, shift, position);
    double after = distance_from_star(mesh, star, position, shift, scaled(shift, -1), old);
    return after > before + tolerance;
}

#define GOOD_SHAPE 0.2 /* area over squared edges; 0.29 in an equilateral triangle */

/* Whether the faces around the vertex of `star` stay well shaped, or get better, and bend no more than before, and no
 * edge gets longer than `limit`. */
static int stays_good(const Triangulation *mesh, int32_t v, const Star *star, const double *position, double limit)
{
    for (int i = 0; i < star->count; i++)
        if (squared_distance(position, mapped_at(mesh, end_of(mesh, star->half_edge[i]))) > limit * limit) return 0;
    Shape beyond[MOST_FACES];
    for (int i = 0; i < star->count; i++) {
        int32_t t = mesh->twin[next(star->half_edge[i])];
        beyond[i].area = -1;
        if (t >= 0)
            beyond[i] = shape_of(mapped_at(mesh, mesh->corner[t]), mapped_at(mesh, end_of(mesh, t)),
                                 mapped_at(mesh, mesh->corner[previous(t)]));
    }
    StarShape after = star_shape(mesh, star, position, beyond);
    if (after.quality >= GOOD_SHAPE && after.bend >= CREASE) return 1;
    StarShape before = star_shape(mesh, star, mapped_at(mesh, v), beyond);
    return after.quality >= smaller(before.quality, GOOD_SHAPE) && after.bend >= smaller(before.bend, CREASE);
}

/* Move the vertices whose faces do not get worse by it. Returns their number. */
static int64_t move_vertices(Triangulation *mesh, Places *places, const double *mapped)
{
    int64_t moves = 0;
    for (int32_t i = 0; i < places->count; i++) {
        const double *position = mapped + 3 * (size_t)i;
        Star star;
        int32_t v = places->item[i];
        if (find_star(mesh, v, &star) && stays_good(mesh, v, &star, position, places->aim.limit)
            && !strays(mesh, v, &star, position, places->shift[i].vector, places->aim.tolerance))
            moves += move_vertex(mesh, v, &star, &places->shift[i], &places->point[i], position);
    }
    places->count = 0;
    return moves;
}

#endif
