/* First hit of a ray, watertight: a ray through an edge or a corner shared by two faces hits at least one of them.
 *
 * Woop, Benthin, Wald 2013: the triangle is sheared so that the ray becomes an axis; the signs of the three edge
 * functions then agree exactly between neighbours, because a shared edge gives the same products. */
#ifndef NDF_BVH_RAY_H
#define NDF_BVH_RAY_H

#include "bvh_closest.h"

typedef struct {
    double origin[3], direction[3]; /* scaled frame; the largest component of the direction is in [0.5, 1) */
    double shear[3];                /* x and y per z, and 1 / z */
    int axes[3];                    /* x, y, z of the sheared frame: z is the direction's largest component */
    float near_origin[3], far_origin[3], over[3];
    int backwards[3];
    double stretch; /* t of the caller's direction = t * stretch */
} Ray;

typedef struct {
    double t;
    int32_t face;
} Hit;

static Ray make_ray(const Tree *tree, const double *origin, const double *direction)
{
    Ray ray;
    int z = 0, exponent;
    for (int k = 1; k < 3; k++) z = fabs(direction[k]) > fabs(direction[z]) ? k : z;
    frexp(direction[z], &exponent);
    for (int k = 0; k < 3; k++) {
        ray.origin[k] = (origin[k] - tree->center[k]) * tree->scale;
        ray.direction[k] = ldexp(direction[k], -exponent);
        double d = ray.direction[k], o = ray.origin[k] < -1e18 ? -1e18 : ray.origin[k] > 1e18 ? 1e18 : ray.origin[k];
        ray.backwards[k] = d < 0.0;
        /* A direction without this component gets a tiny one: products stay finite, and slabs decide as they should. */
        ray.over[k] = (float)(fabs(d) > 1e-18 ? 1.0 / d : d < 0.0 ? -1e18 : 1e18);
        double margin = fabs(o) * 2.4e-7 + 1e-7;
        ray.near_origin[k] = (float)(ray.backwards[k] ? o - margin : o + margin);
        ray.far_origin[k] = (float)(ray.backwards[k] ? o + margin : o - margin);
    }
    ray.axes[0] = (z + 1) % 3;
    ray.axes[1] = (z + 2) % 3;
    ray.axes[2] = z;
    ray.shear[0] = ray.direction[ray.axes[0]] / ray.direction[z];
    ray.shear[1] = ray.direction[ray.axes[1]] / ray.direction[z];
    ray.shear[2] = 1.0 / ray.direction[z];
    ray.stretch = ldexp(1.0, -exponent) / tree->scale;
    return ray;
}

INLINE void leaf_hits(const Leaf *leaf, const Ray *ray, double *t)
{
    const double *o = ray->origin, *s = ray->shear;
    int x = ray->axes[0], y = ray->axes[1], z = ray->axes[2];
    for (int i = 0; i < LANES; i++) {
        double az = leaf->a[z][i] - o[z], bz = leaf->b[z][i] - o[z], cz = leaf->c[z][i] - o[z];
        double ax = leaf->a[x][i] - o[x] - s[0] * az, ay = leaf->a[y][i] - o[y] - s[1] * az;
        double bx = leaf->b[x][i] - o[x] - s[0] * bz, by = leaf->b[y][i] - o[y] - s[1] * bz;
        double cx = leaf->c[x][i] - o[x] - s[0] * cz, cy = leaf->c[y][i] - o[y] - s[1] * cz;
        double u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
        double det = u + v + w;
        double at = (u * az + v * bz + w * cz) * s[2] / det;
        int one_sided = ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        t[i] = one_sided & (det != 0.0) & (at >= 0.0) ? at : INFINITY;
    }
}

INLINE void box_entries(const Node *node, const Ray *ray, float *enter, float *leave)
{
    for (int i = 0; i < WIDTH; i++) { enter[i] = 0.0f; leave[i] = FLT_MAX; }
    for (int k = 0; k < 3; k++) {
        const float *close = ray->backwards[k] ? node->high[k] : node->low[k];
        const float *away = ray->backwards[k] ? node->low[k] : node->high[k];
        for (int i = 0; i < WIDTH; i++) {
            float first = (close[i] - ray->near_origin[k]) * ray->over[k];
            float last = (away[i] - ray->far_origin[k]) * ray->over[k];
            enter[i] = first > enter[i] ? first : enter[i];
            leave[i] = last < leave[i] ? last : leave[i];
        }
    }
}

INLINE Hit first_hit_face(const Tree *tree, const Ray *ray)
{
    Hit best = {INFINITY, -1};
    float bound = FLT_MAX;
    Entry stack[STACK];
    int top = 0;
    stack[top++] = (Entry){0.0f, 0};
    while (top) {
        Entry entry = stack[--top];
        if (entry.lower > bound) continue;
        if (entry.child < 0) {
            const Leaf *leaf = &tree->leaves[~entry.child];
            double t[LANES];
            leaf_hits(leaf, ray, t);
            for (int i = 0; i < LANES; i++)
                if (t[i] < best.t || (t[i] == best.t && t[i] < INFINITY && leaf->face[i] < best.face)) {
                    best.t = t[i];
                    best.face = leaf->face[i];
                }
            bound = best.t < 1e30 ? (float)(best.t * 1.000002 + 1e-6) : FLT_MAX;
            continue;
        }
        const Node *node = &tree->nodes[entry.child];
        float enter[WIDTH], leave[WIDTH];
        box_entries(node, ray, enter, leave);
        int base = top;
        for (int i = 0; i < WIDTH; i++) {
            if (enter[i] > bound || enter[i] > leave[i] * 1.000002f) continue;
            int at = top++;
            for (; at > base && stack[at - 1].lower < enter[i]; at--) stack[at] = stack[at - 1];
            stack[at] = (Entry){enter[i], node->child[i]};
        }
    }
    return best;
}

VECTOR_CLONES
static void first_hit_rows(const Tree *tree, const double *origins, const double *directions, int64_t count, double *t,
                           int32_t *faces)
{
    for (int64_t row = 0; row < count; row++) {
        Ray ray = make_ray(tree, origins + 3 * row, directions + 3 * row);
        Hit hit = first_hit_face(tree, &ray);
        t[row] = hit.t * ray.stretch;
        faces[row] = hit.face;
    }
}

#endif
