/* The mapped mesh: lengths, areas and bends of its faces in space. */
#ifndef NDF_MAPPED_H
#define NDF_MAPPED_H

#include "compiler.h"
#include "edits.h"

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

INLINE Shape shape_of(const double *p, const double *q, const double *r)
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

/* The product of two faces' unit normals. */
static inline double bend(const Shape *one, const Shape *two)
{
    return dot3(one->normal, two->normal) / larger(one->area * two->area, 1e-300);
}

/* The sum of the normals of the faces beside h, and its length. */
static double normal_across(const Triangulation *mesh, int32_t h, double *normal)
{
    int32_t g = mesh->twin[h];
    const double *a = mapped_at(mesh, mesh->corner[h]), *b = mapped_at(mesh, end_of(mesh, h));
    Shape left = shape_of(a, b, mapped_at(mesh, mesh->corner[previous(h)])), right = {{0, 0, 0}, 0, 0};
    if (g >= 0) right = shape_of(b, a, mapped_at(mesh, mesh->corner[previous(g)]));
    for (int k = 0; k < 3; k++) normal[k] = left.normal[k] + right.normal[k];
    return sqrt(dot3(normal, normal));
}

/* Distance from the middle of vertices v and w to `point` along the normal. */
static double height_over(const Triangulation *mesh, int32_t v, int32_t w, const double *point, const double *normal,
                          double size)
{
    const double *p = mapped_at(mesh, v), *q = mapped_at(mesh, w);
    double height = 0;
    for (int k = 0; k < 3; k++) height += normal[k] * (point[k] - 0.5 * (p[k] + q[k]));
    return fabs(height) / larger(size, 1e-300);
}

static void measure_mapped(const Triangulation *mesh, double *area, double *longest)
{
    double square = *area = 0;
    for (int32_t h = 0; h < 3 * mesh->faces; h += 3) {
        if (mesh->corner[h] < 0) continue;
        const double *p = mapped_at(mesh, mesh->corner[h]), *q = mapped_at(mesh, mesh->corner[h + 1]);
        *area += 0.5 * shape_of(p, q, mapped_at(mesh, mesh->corner[h + 2])).area;
        for (int i = 0; i < 3; i++) square = larger(square, mapped_square(mesh, h + i));
    }
    *longest = sqrt(square);
}

/* ---- what passes plan ---- */

typedef enum { ODT, DELAUNAY, UNFOLD, SPREAD } Criterion;

/* What edits are to achieve, and what they must not do. */
typedef struct {
    Criterion criterion; /* of flips */
    double limit;        /* no edge longer than this replaces a shorter one */
    double tolerance;    /* by how much farther than before the mesh may be from the surface */
} Aim;

/* Points where a pass needs the map, and what it needs them for. */
typedef struct {
    int32_t count, capacity;
    int32_t *item; /* half-edges or vertices */
    Point *point;
    Shift *shift; /* only of vertices that move */
    int32_t shift_capacity;
    Aim aim;
} Places;

static int places_add(Places *places, int32_t item, const Point *point)
{
    if (places->count == places->capacity) {
        size_t capacity = places->capacity < 1024 ? 1024 : 2 * (size_t)places->capacity;
        if (capacity > INT32_MAX || !resize((void **)&places->item, capacity, sizeof *places->item)
            || !resize((void **)&places->point, capacity, sizeof *places->point))
            return 0;
        places->capacity = (int32_t)capacity;
    }
    places->item[places->count] = item;
    places->point[places->count++] = *point;
    return 1;
}

static inline int is_edge(const Triangulation *mesh, int32_t h)
{
    return mesh->corner[h] >= 0 && mesh->twin[h] < h;
}

#endif
