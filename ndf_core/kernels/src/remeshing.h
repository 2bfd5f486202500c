/* The passes of remeshing (Sec. 3.4): what to split, remove, flip and move, by lengths and areas of the mapped mesh. */
#ifndef NDF_REMESHING_H
#define NDF_REMESHING_H

#include "edits.h"

/* ---- the mapped mesh ---- */

static inline const double *mapped_at(const Triangulation *mesh, int32_t v) { return mesh->mapped + 3 * (size_t)v; }
static inline double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static double squared_distance(const double *p, const double *q)
{
    double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
    return x * x + y * y + z * z;
}

static inline double mapped_square(const Triangulation *mesh, int32_t h)
{
    return squared_distance(mapped_at(mesh, mesh->corner[h]), mapped_at(mesh, end_of(mesh, h)));
}

typedef struct {
    double normal[3], area; /* of length `area`, which is twice the area */
    double squares;         /* sum of the squared lengths of the edges */
} Shape;

static Shape shape_of(const double *p, const double *q, const double *r)
{
    double u[3], v[3];
    for (int k = 0; k < 3; k++) {
        u[k] = q[k] - p[k];
        v[k] = r[k] - p[k];
    }
    Shape shape = {{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]}, 0, 0};
    shape.area = sqrt(dot3(shape.normal, shape.normal));
    shape.squares = dot3(u, u) + dot3(v, v) + squared_distance(q, r);
    return shape;
}

static void measure_mapped(const Triangulation *mesh, double *area, double *longest)
{
    double square = *area = 0;
    for (int32_t h = 0; h < 3 * mesh->faces; h += 3) {
        if (mesh->corner[h] < 0) continue;
        const double *p = mapped_at(mesh, mesh->corner[h]), *q = mapped_at(mesh, mesh->corner[h + 1]);
        *area += 0.5 * shape_of(p, q, mapped_at(mesh, mesh->corner[h + 2])).area;
        for (int i = 0; i < 3; i++) square = fmax(square, mapped_square(mesh, h + i));
    }
    *longest = sqrt(square);
}

/* ---- long edges ---- */

typedef struct {
    int32_t count, capacity;
    int32_t *item; /* half-edges or vertices */
    Point *point;  /* where they are to get a vertex, or to be */
    Vector *shift; /* of a vertex, in the plane of the face that it is in */
    double limit;  /* moves may make no edge longer than this */
} Places;

static int places_add(Places *places, int32_t item, const Point *point, Vector shift)
{
    if (places->count == places->capacity) {
        size_t capacity = places->capacity < 1024 ? 1024 : 2 * (size_t)places->capacity;
        if (capacity > INT32_MAX || !resize((void **)&places->item, capacity, sizeof *places->item)
            || !resize((void **)&places->point, capacity, sizeof *places->point)
            || !resize((void **)&places->shift, capacity, sizeof *places->shift))
            return 0;
        places->capacity = (int32_t)capacity;
    }
    places->item[places->count] = item;
    places->shift[places->count] = shift;
    places->point[places->count++] = *point;
    return 1;
}

static inline int is_edge(const Triangulation *mesh, int32_t h)
{
    return mesh->corner[h] >= 0 && mesh->twin[h] < h;
}

#define THINNEST 0.25 /* altitude over longest edge, on the surface */

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
 * middle. */
static int find_long_edges(const Triangulation *mesh, double limit, int along, Places *places, int32_t *refused)
{
    size_t half_edges = 3 * (size_t)mesh->faces;
    uint8_t *marks = malloc(half_edges + 1);
    int done = marks != NULL;
    places->count = *refused = 0;
    for (int32_t h = 0; done && h < 3 * mesh->faces; h++)
        marks[h] = mesh->corner[h] >= 0 && mapped_square(mesh, h) > limit * limit;
    for (int32_t h = 0; done && along && h < 3 * mesh->faces; h += 3)
        if (marks[h] || marks[h + 1] || marks[h + 2]) mark_along(mesh, marks, h / 3);
    for (int32_t h = 0; done && h < 3 * mesh->faces; h++) {
        Point middle;
        if (!marks[h] || !is_edge(mesh, h)) continue;
        if (!find_middle(mesh, h, &middle))
            ++*refused;
        else
            done = places_add(places, h, &middle, (Vector){0, 0});
    }
    free(marks);
    return done;
}

/* Split at the places found; `mapped` has their positions. Returns how many splits were refused, -1 without memory. */
static int32_t split_long_edges(Triangulation *mesh, const Places *places, const double *mapped)
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

/* ---- flips ---- */

typedef enum { ODT, DELAUNAY, UNFOLD } Criterion;

#define FOLD -0.5       /* product of the unit normals of faces that count as folded over each other */
#define CREASE 0.5      /* and of faces with a crease between them: 60 degrees */
#define LEAST_GAIN 0.05 /* by which unfolding has to raise the smallest product around an edge */
#define STILL_HELD -2.0 /* sum of the opposite cotangents down to which a crease is kept */
#define STRAIGHT 0.02   /* distance of a vertex on a crease from its neighbours' line, over their distance */

static inline double bend(const Shape *one, const Shape *two)
{
    return dot3(one->normal, two->normal) / fmax(one->area * two->area, 1e-300);
}

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
        sharpest = fmin(sharpest, bend(before[i], &beyond));
        sharper = fmin(sharper, bend(after[i], &beyond));
    }
    return gain > 0 ? sharper >= sharpest + gain : sharper >= fmin(sharpest, CREASE);
}

static int gets_better(const Triangulation *mesh, int32_t h, Criterion criterion, double limit)
{
    int32_t g = mesh->twin[h];
    const double *a = mapped_at(mesh, mesh->corner[h]), *b = mapped_at(mesh, mesh->corner[g]);
    const double *c = mapped_at(mesh, mesh->corner[previous(h)]), *d = mapped_at(mesh, mesh->corner[previous(g)]);
    double along = squared_distance(a, b);
    double at_c = squared_distance(c, a) + squared_distance(c, b) - along; /* positive where the angle is acute */
    double at_d = squared_distance(d, a) + squared_distance(d, b) - along;
    if (criterion != UNFOLD && at_c >= 0 && at_d >= 0) return 0;
    double across = squared_distance(c, d);
    if (across > limit * limit && across > along) return 0;
    Shape left = shape_of(a, b, c), right = shape_of(b, a, d);
    if (criterion == DELAUNAY && at_c * right.area + at_d * left.area >= -1e-9 * left.area * right.area) return 0;
    double bent = bend(&left, &right);
    if (criterion == UNFOLD && bent >= FOLD) return 0;
    /* Creases stay, since a flip would cut them off, unless their faces are thin. */
    if (criterion != UNFOLD && bent < CREASE && at_c / left.area + at_d / right.area > 2 * STILL_HELD) return 0;
    Shape first = shape_of(a, d, c), second = shape_of(d, b, c);
    if (criterion == ODT) {
        double before = left.area * left.squares + right.area * right.squares;
        if (first.area * first.squares + second.area * second.squares >= before * (1 - 1e-9)) return 0;
    }
    if (!(first.area > 0 && second.area > 0)) return 0;
    return keeps_smooth(mesh, h, &left, &right, &first, &second, criterion == UNFOLD ? LEAST_GAIN : 0);
}

/* Flip edges while that makes the mapped mesh better, but none to more than `limit` unless it was longer. `waiting` has
 * a byte per half-edge, `stack` an entry. Returns the number of flips. */
static int64_t flip_edges(Triangulation *mesh, Criterion criterion, double limit, uint8_t *waiting, int32_t *stack)
{
    int32_t count = 0;
    int64_t flips = 0, most = 30 * (int64_t)mesh->faces;
    for (int32_t h = 3 * mesh->faces - 1; h >= 0; h--) {
        waiting[h] = is_edge(mesh, h) && mesh->twin[h] >= 0;
        if (waiting[h]) stack[count++] = h;
    }
    while (count && flips < most) {
        int32_t h = stack[--count], g = mesh->twin[h];
        waiting[h] = 0;
        if (!gets_better(mesh, h, criterion, limit) || !flip_if_valid(mesh, h)) continue;
        flips++;
        const int32_t around[4] = {h, previous(h), g, previous(g)};
        for (int i = 0; i < 4; i++) {
            int32_t twin = mesh->twin[around[i]];
            if (twin < 0 || waiting[around[i]] || waiting[twin]) continue;
            waiting[around[i]] = 1;
            stack[count++] = around[i];
        }
    }
    return flips;
}

/* ---- moves ---- */

/* The shift that takes a vertex to the mean of the faces around it, weighted with their mapped areas: where the map is
 * affine, the same as that mean in the mapped mesh. On a crease, to the middle between its neighbours there, if these
 * lie on a line with it; a crease may be left where it is a fold. Returns 0 for ends, corners and turns of creases. */
static int find_shift(const Triangulation *mesh, int32_t v, const Star *star, int folded, Vector *shift)
{
    Shape shapes[MOST_FACES];
    Vector sum = {0, 0}, crease[2] = {{0, 0}, {0, 0}};
    double total = 0;
    int creases = 0;
    for (int i = 0; i < star->count; i++) {
        int k = i + 1 < star->count ? i + 1 : 0;
        shapes[i] = shape_of(mapped_at(mesh, v), mapped_at(mesh, end_of(mesh, star->half_edge[i])),
                             mapped_at(mesh, end_of(mesh, star->half_edge[k])));
        sum = plus(sum, scaled(plus(star->place[i], star->place[k]), shapes[i].area));
        total += shapes[i].area;
    }
    for (int i = 0; i < star->count; i++)
        if (bend(&shapes[i], &shapes[i > 0 ? i - 1 : star->count - 1]) < CREASE && creases++ < 2)
            crease[creases - 1] = star->place[i];
    *shift = total > 0 ? scaled(sum, 1 / (3 * total)) : sum;
    if (creases == 0 || folded) return total > 0;
    Vector line = minus(crease[1], crease[0]);
    if (creases != 2 || !(fabs(cross(crease[0], crease[1])) < STRAIGHT * inner(line, line))) return 0;
    *shift = scaled(line, inner(line, scaled(plus(crease[0], crease[1]), 0.5)) / inner(line, line));
    return 1;
}

/* Mark the four vertices around every edge whose faces lie folded over each other. */
static void mark_folded(const Triangulation *mesh, uint8_t *marks)
{
    for (int32_t h = 0; h < 3 * mesh->faces; h++) {
        int32_t g = mesh->twin[h];
        if (!is_edge(mesh, h) || g < 0) continue;
        int32_t quad[4] = {mesh->corner[h], mesh->corner[g], mesh->corner[previous(h)], mesh->corner[previous(g)]};
        Shape left = shape_of(mapped_at(mesh, quad[0]), mapped_at(mesh, quad[1]), mapped_at(mesh, quad[2]));
        Shape right = shape_of(mapped_at(mesh, quad[1]), mapped_at(mesh, quad[0]), mapped_at(mesh, quad[3]));
        if (bend(&left, &right) < FOLD)
            for (int i = 0; i < 4; i++) marks[quad[i]] = 1;
    }
}

/* Places for the vertices that may move, all or those beside folds. Returns 0 without memory. */
static int find_moves(const Triangulation *mesh, int folded, double limit, Places *places)
{
    uint8_t *marks = calloc((size_t)mesh->vertices + 1, 1);
    int done = marks != NULL;
    places->count = 0;
    places->limit = limit;
    if (done && folded) mark_folded(mesh, marks);
    for (int32_t v = 0; done && v < mesh->vertices; v++) {
        Star star;
        Trace trace;
        Point point;
        if (marks[v] != folded || mesh->outgoing[v] < 0 || !find_star(mesh, v, &star)) continue;
        Vector shift;
        if (find_shift(mesh, v, &star, folded, &shift) && star_sees(&star, shift)
            && find_shifted(mesh, v, &star, shift, &trace, &point))
            done = places_add(places, v, &point, shift);
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
            result.quality = fmin(result.quality, shape.area / fmax(shape.squares, 1e-300));
            if (beyond[i].area >= 0) result.bend = fmin(result.bend, bend(&shape, &beyond[i]));
        }
        if (i > 0) result.bend = fmin(result.bend, bend(&shape, &before));
        if (i == 0) first = shape;
        before = shape;
    }
    return result;
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
    StarShape before = star_shape(mesh, star, mapped_at(mesh, v), beyond);
    StarShape after = star_shape(mesh, star, position, beyond);
    return after.quality >= fmin(before.quality, GOOD_SHAPE) && after.bend >= fmin(before.bend, CREASE);
}

/* Move the vertices whose faces do not get worse by it. Returns their number. */
static int32_t move_vertices(Triangulation *mesh, const Places *places, const double *mapped)
{
    int32_t moves = 0;
    for (int32_t i = 0; i < places->count; i++) {
        const double *position = mapped + 3 * (size_t)i;
        Star star;
        int32_t v = places->item[i];
        if (find_star(mesh, v, &star) && stays_good(mesh, v, &star, position, places->limit))
            moves += move_vertex(mesh, v, &star, places->shift[i], &places->point[i], position);
    }
    return moves;
}

#endif
