/* A triangle mesh as an intrinsic surface: flat triangles glued along their edges, each laid out in a plane of its own.
 * Points are a face and barycentric weights; straight lines are followed from face to face by unfolding.
 */
#ifndef NDF_UNFOLDING_H
#define NDF_UNFOLDING_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

static inline int32_t next(int32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
static inline int32_t previous(int32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

/* ---- the plane, its vectors as complex numbers ---- */

/* fmax and fmin are calls, since they have to mind what is no number. */
static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

typedef struct {
    double x, y;
} Vector;

static inline Vector plus(Vector a, Vector b) { return (Vector){a.x + b.x, a.y + b.y}; }
static inline Vector minus(Vector a, Vector b) { return (Vector){a.x - b.x, a.y - b.y}; }
static inline Vector scaled(Vector a, double s) { return (Vector){a.x * s, a.y * s}; }
static inline Vector times(Vector a, Vector b) { return (Vector){a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x}; }
static inline Vector conjugate(Vector a) { return (Vector){a.x, -a.y}; }
static inline double inner(Vector a, Vector b) { return a.x * b.x + a.y * b.y; }
static inline double cross(Vector a, Vector b) { return a.x * b.y - a.y * b.x; }
static inline double length(Vector a) { return sqrt(inner(a, a)); }
static inline Vector over(Vector a, Vector b) { return scaled(times(a, conjugate(b)), 1 / inner(b, b)); }

/* p -> turn p + shift, where |turn| = 1. */
typedef struct {
    Vector turn, shift;
} Motion;

static inline Vector moved(Motion m, Vector p) { return plus(times(m.turn, p), m.shift); }
static inline Vector moved_back(Motion m, Vector p) { return times(conjugate(m.turn), minus(p, m.shift)); }
static inline Motion then(Motion first, Motion second)
{
    return (Motion){times(second.turn, first.turn), moved(second, first.shift)};
}

/* ---- the surface ---- */

/* Slack (b + c - a over the mean edge length) that every corner of a face gets. It bounds angles from below by about as
 * much, so that thin faces neither cost precision nor need cases of their own. */
#define LEAST_SLACK 1e-5
#define OUTSIDE -1e-10 /* weights down to here count as inside a face */
#define ON_EDGE 1e-8   /* weights below this become zero: ten times what decisions need, a hundred times `OUTSIDE` */

typedef struct {
    int32_t faces;
    const int32_t *corners, *twins; /* half-edge 3 f + i runs from corner i to corner i + 1; twin -1 at a border */
    Vector *corner;                 /* by half-edge: where its first corner lies in the face's plane */
    Motion *across;                 /* by half-edge: from its face's plane to its twin's */
    double size;                    /* mean length of an edge */
} Surface;

typedef struct {
    double weight[3];
    int32_t face;
} Point;

/* Lengths of the edges with a constant added, so that every face has the least slack (Sharp, Crane 2020). Returns -1 if
 * they are not finite. */
static int relaxed_lengths(Surface *surface, const double *positions, double *lengths)
{
    int32_t half_edges = 3 * surface->faces;
    double total = 0, missing = 0;
    for (int32_t h = 0; h < half_edges; h++) {
        const double *p = positions + 3 * (size_t)surface->corners[h];
        const double *q = positions + 3 * (size_t)surface->corners[next(h)];
        double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
        total += lengths[h] = sqrt(x * x + y * y + z * z);
    }
    if (!(total < 1e150)) return -1;
    double least = total > 0 ? LEAST_SLACK * total / half_edges : 1;
    for (int32_t h = 0; h < half_edges; h++)
        missing = larger(missing, least - (lengths[next(h)] + lengths[previous(h)] - lengths[h]));
    for (int32_t h = 0; h < half_edges; h++) lengths[h] += missing;
    surface->size = half_edges > 0 ? total / half_edges + missing : 1;
    return 0;
}

/* The apex over the segment from 0 to `base` on the x axis, at distances `left` from 0 and `right` from its end. */
static inline Vector apex(double base, double left, double right)
{
    double x = 0.5 * (base + (left - right) * (left + right) / base);
    return (Vector){x, sqrt(larger((left - x) * (left + x), 0))};
}

static void lay_out(Surface *surface, const double *lengths)
{
    for (int32_t h = 0; h < 3 * surface->faces; h += 3) {
        surface->corner[h] = (Vector){0, 0};
        surface->corner[h + 1] = (Vector){lengths[h], 0};
        surface->corner[h + 2] = apex(lengths[h], lengths[h + 2], lengths[h + 1]);
    }
    for (int32_t h = 0; h < 3 * surface->faces; h++) {
        int32_t g = surface->twins[h];
        if (g < 0) continue;
        Vector a = surface->corner[h], b = surface->corner[next(h)];
        Vector c = surface->corner[next(g)], d = surface->corner[g];
        Vector turn = over(minus(d, c), minus(b, a));
        turn = scaled(turn, 1 / length(turn));
        Vector shift = minus(scaled(plus(c, d), 0.5), times(turn, scaled(plus(a, b), 0.5)));
        surface->across[h] = (Motion){turn, shift};
    }
}

static void surface_free(Surface *surface)
{
    free(surface->corner);
    free(surface->across);
}

/* Returns 0, -1 if positions are not finite, -2 without memory. `corners` and `twins` are borrowed. */
static int surface_create(Surface *surface, const int32_t *corners, const int32_t *twins, int32_t faces,
                          const double *positions)
{
    size_t half_edges = 3 * (size_t)faces;
    *surface = (Surface){faces, corners, twins, malloc((half_edges + 1) * sizeof(Vector)),
                         malloc((half_edges + 1) * sizeof(Motion)), 1};
    double *lengths = malloc((half_edges + 1) * sizeof *lengths);
    int result = surface->corner && surface->across && lengths ? relaxed_lengths(surface, positions, lengths) : -2;
    if (result == 0) lay_out(surface, lengths);
    free(lengths);
    if (result < 0) surface_free(surface);
    return result;
}

/* ---- points ---- */

static inline Vector at_weights(const Surface *surface, int32_t face, const double *weight)
{
    const Vector *corner = surface->corner + 3 * (size_t)face;
    return (Vector){weight[0] * corner[0].x + weight[1] * corner[1].x + weight[2] * corner[2].x,
                    weight[0] * corner[0].y + weight[1] * corner[1].y + weight[2] * corner[2].y};
}

static inline void weights_at(const Surface *surface, int32_t face, Vector p, double *weight)
{
    const Vector *corner = surface->corner + 3 * (size_t)face;
    double area = corner[1].x * corner[2].y; /* the first corner is 0, the second on the x axis; twice the area */
    weight[1] = cross(p, corner[2]) / area;
    weight[2] = p.y / corner[2].y;
    weight[0] = 1 - weight[1] - weight[2];
}

/* Where a point lies in the plane of a face whose closure holds it; 0 for any other face. */
static int place_in(const Surface *surface, const Point *point, int32_t face, Vector *place)
{
    const double *weight = point->weight;
    double turned[3] = {0, 0, 0};
    if (face != point->face) {
        if (weight[0] != 0 && weight[1] != 0 && weight[2] != 0) return 0;
        const int32_t *own = surface->corners + 3 * (size_t)point->face, *other = surface->corners + 3 * (size_t)face;
        for (int i = 0; i < 3; i++) {
            if (weight[i] == 0) continue;
            int k = own[i] == other[0] ? 0 : own[i] == other[1] ? 1 : own[i] == other[2] ? 2 : -1;
            if (k < 0) return 0;
            turned[k] = weight[i];
        }
        weight = turned;
    }
    *place = at_weights(surface, face, weight);
    return 1;
}

/* The point at `p` in the plane of a face, moved onto an edge that it is very close to. Returns 0 at a corner. */
static int point_at(const Surface *surface, int32_t face, Vector p, Point *point)
{
    double weight[3];
    weights_at(surface, face, p, weight);
    int largest = weight[0] >= weight[1] && weight[0] >= weight[2] ? 0 : weight[1] >= weight[2] ? 1 : 2;
    int i = (largest + 1) % 3, k = (largest + 2) % 3;
    if (weight[i] < ON_EDGE) weight[i] = 0;
    if (weight[k] < ON_EDGE) weight[k] = 0;
    weight[largest] = 1 - weight[i] - weight[k];
    *point = (Point){{weight[0], weight[1], weight[2]}, face};
    return weight[i] > 0 || weight[k] > 0;
}

/* The corner that a point is, 0 to 2, or -1. */
static inline int corner_of(const Point *point)
{
    for (int i = 0; i < 3; i++)
        if (point->weight[i] == 1) return i;
    return -1;
}

/* ---- straight lines ---- */

#define MOST_CROSSINGS 10000

typedef struct {
    int32_t face;
    Vector place;  /* in the plane of `face` */
    Motion motion; /* from the plane of the first face to that of `face` */
} Trace;

/* The half-edge through which the line from `p`, in the closure of the face, to `q`, outside, leaves it. */
static int32_t first_exit(const Surface *surface, int32_t face, Vector p, const double *q_weight)
{
    double p_weight[3], soonest = INFINITY;
    int32_t exit = -1;
    weights_at(surface, face, p, p_weight);
    for (int k = 0; k < 3; k++) {
        if (q_weight[k] >= OUTSIDE) continue;
        double inside = larger(p_weight[k], 0), when = inside / (inside - q_weight[k]);
        if (when < soonest) {
            soonest = when;
            exit = 3 * face + (k + 1) % 3; /* the edge opposite corner k */
        }
    }
    return exit;
}

/* Follow `vector` from `start` in the plane of `face`. Returns 0 where the line leaves the surface or does not end. */
static int trace_line(const Surface *surface, int32_t face, Vector start, Vector vector, Trace *trace)
{
    Motion motion = {{1, 0}, {0, 0}};
    Vector end = plus(start, vector);
    int32_t entered = -1;
    for (int crossings = 0; crossings < MOST_CROSSINGS; crossings++) {
        double weight[3];
        Vector q = moved(motion, end);
        weights_at(surface, face, q, weight);
        if (weight[0] >= OUTSIDE && weight[1] >= OUTSIDE && weight[2] >= OUTSIDE) {
            *trace = (Trace){face, q, motion};
            return 1;
        }
        int32_t exit;
        if (entered < 0) {
            exit = first_exit(surface, face, start, weight);
        } else { /* leave to the right or left of the corner opposite the edge that was entered */
            Vector corner = minus(surface->corner[previous(entered)], moved(motion, start));
            exit = cross(times(motion.turn, vector), corner) > 0 ? next(entered) : previous(entered);
        }
        if (exit < 0 || surface->twins[exit] < 0) return 0;
        motion = then(motion, surface->across[exit]);
        entered = surface->twins[exit];
        face = entered / 3;
    }
    return 0;
}

/* Whether a trace ended at `target` within `tolerance`, or just across an edge from there; it is made to end there. */
static int arrives(const Surface *surface, Trace *trace, const Point *target, double tolerance)
{
    Vector place;
    if (place_in(surface, target, trace->face, &place) && length(minus(place, trace->place)) <= tolerance) {
        trace->place = place;
        return 1;
    }
    for (int32_t h = 3 * trace->face; h < 3 * trace->face + 3; h++) {
        int32_t g = surface->twins[h];
        if (g < 0 || !place_in(surface, target, g / 3, &place)
            || length(minus(place, moved(surface->across[h], trace->place))) > tolerance)
            continue;
        *trace = (Trace){g / 3, place, then(trace->motion, surface->across[h])};
        return 1;
    }
    return 0;
}

#endif
