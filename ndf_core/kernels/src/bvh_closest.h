/* Closest point of the mesh: a branch-and-bound descent whose answer is a pure function of the query.
 *
 * The distance of a query to a face is computed by one sequence of IEEE operations (no contraction to fused
 * multiply-adds under -std=c11), boxes give true lower bounds of it, and equal distances go to the smaller face
 * index. So neither the order of the queries nor the first upper bound can change an answer. */
#ifndef NDF_BVH_CLOSEST_H
#define NDF_BVH_CLOSEST_H

#include "bvh_tree.h"

typedef struct {
    double squared;
    int32_t face;
} Nearest;

typedef struct {
    float lower;
    int32_t child;
} Entry;

INLINE double clamp01(double t)
{
    t = t > 0.0 ? t : 0.0; /* also NaN, from queries whose products overflow */
    return t < 1.0 ? t : 1.0;
}

/* Squared distance to each triangle of a leaf: the least over the three edges and, where the projection falls inside,
 * the plane. Every candidate is measured to a point of the triangle, so slivers lose tangential precision only. */
INLINE void leaf_distances(const Leaf *leaf, const double *q, double *squared)
{
    for (int i = 0; i < LANES; i++) {
        double ax = leaf->a[0][i], ay = leaf->a[1][i], az = leaf->a[2][i];
        double bx = leaf->b[0][i], by = leaf->b[1][i], bz = leaf->b[2][i];
        double cx = leaf->c[0][i], cy = leaf->c[1][i], cz = leaf->c[2][i];
        double abx = bx - ax, aby = by - ay, abz = bz - az;
        double acx = cx - ax, acy = cy - ay, acz = cz - az;
        double x = q[0] - ax, y = q[1] - ay, z = q[2] - az;
        double on_ab = x * abx + y * aby + z * abz, on_ac = x * acx + y * acy + z * acz;

        double t = clamp01(on_ab * leaf->over_ab[i]);
        double rx = x - t * abx, ry = y - t * aby, rz = z - t * abz;
        double least = rx * rx + ry * ry + rz * rz;

        t = clamp01(on_ac * leaf->over_ac[i]);
        rx = x - t * acx, ry = y - t * acy, rz = z - t * acz;
        double other = rx * rx + ry * ry + rz * rz;
        least = other < least ? other : least;

        t = clamp01((on_ac - on_ab + leaf->ab_ab[i] - leaf->ab_ac[i]) * leaf->over_bc[i]);
        rx = q[0] - bx - t * (cx - bx), ry = q[1] - by - t * (cy - by), rz = q[2] - bz - t * (cz - bz);
        other = rx * rx + ry * ry + rz * rz;
        least = other < least ? other : least;

        double v = (leaf->ac_ac[i] * on_ab - leaf->ab_ac[i] * on_ac) * leaf->over_area[i];
        double w = (leaf->ab_ab[i] * on_ac - leaf->ab_ac[i] * on_ab) * leaf->over_area[i];
        rx = x - v * abx - w * acx, ry = y - v * aby - w * acy, rz = z - v * abz - w * acz;
        other = rx * rx + ry * ry + rz * rz;
        int inside = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0);
        squared[i] = inside & (other < least) ? other : least;
    }
}

INLINE void leaf_nearest(const Leaf *leaf, const double *q, Nearest *best)
{
    double squared[LANES];
    leaf_distances(leaf, q, squared);
    for (int i = 0; i < LANES; i++)
        if (squared[i] < best->squared || (squared[i] == best->squared && leaf->face[i] < best->face)) {
            best->squared = squared[i];
            best->face = leaf->face[i];
        }
}

/* Upper bound for pruning: the factor covers the roundings of the float box distance, the summand its underflow. */
INLINE float prune_bound(double squared)
{
    double bound = squared * 1.000002 + 1e-36;
    return bound < FLT_MAX ? (float)bound : FLT_MAX;
}

/* `above` and `below` are the query moved by its rounding error towards either side of a box. */
INLINE void box_distances(const Node *node, const float *above, const float *below, float *lower)
{
    for (int i = 0; i < WIDTH; i++) {
        float sum = 0.0f;
        for (int k = 0; k < 3; k++) {
            float under = node->low[k][i] - above[k], over = below[k] - node->high[k][i];
            float gap = under > over ? under : over;
            gap = gap > 0.0f ? gap : 0.0f;
            sum += gap * gap;
        }
        lower[i] = sum;
    }
}

INLINE Nearest closest_face(const Tree *tree, const double *q, int32_t first_leaf)
{
    float above[3], below[3];
    for (int k = 0; k < 3; k++) {
        /* Beyond 1e18 mesh sizes float squares overflow; clamping towards the mesh keeps lower bounds lower. */
        double x = q[k] < -1e18 ? -1e18 : q[k] > 1e18 ? 1e18 : q[k];
        double margin = fabs(x) * 2.4e-7 + 1e-12;
        above[k] = (float)(x + margin);
        below[k] = (float)(x - margin);
    }
    Nearest best = {INFINITY, INT32_MAX};
    leaf_nearest(&tree->leaves[first_leaf], q, &best);
    float bound = prune_bound(best.squared);
    Entry stack[STACK];
    int top = 0;
    stack[top++] = (Entry){0.0f, 0};
    while (top) {
        Entry entry = stack[--top];
        if (entry.lower > bound) continue;
        if (entry.child < 0) {
            if (~entry.child == first_leaf) continue;
            leaf_nearest(&tree->leaves[~entry.child], q, &best);
            bound = prune_bound(best.squared);
            continue;
        }
        const Node *node = &tree->nodes[entry.child];
        float lower[WIDTH];
        box_distances(node, above, below, lower);
        int base = top;
        for (int i = 0; i < WIDTH; i++) {
            if (lower[i] > bound) continue;
            int at = top++;
            for (; at > base && stack[at - 1].lower < lower[i]; at--) stack[at] = stack[at - 1];
            stack[at] = (Entry){lower[i], node->child[i]};
        }
    }
    return best;
}

/* Barycentric coordinates of the interior point over which q lies, or 0 when q lies over none. The solution is refined
 * once from its residual: the normal equations alone lose digits for slivers and for queries far from small faces. */
static int interior_weights(const Leaf *leaf, int lane, const double *q, double *weights, double *squared)
{
    double ab[3], ac[3], r[3], v = 0.0, w = 0.0;
    if (!(leaf->over_area[lane] > 0.0)) return 0;
    for (int k = 0; k < 3; k++) {
        ab[k] = leaf->b[k][lane] - leaf->a[k][lane];
        ac[k] = leaf->c[k][lane] - leaf->a[k][lane];
        r[k] = q[k] - leaf->a[k][lane];
    }
    for (int round = 0; round < 2; round++) {
        double on_ab = r[0] * ab[0] + r[1] * ab[1] + r[2] * ab[2], on_ac = r[0] * ac[0] + r[1] * ac[1] + r[2] * ac[2];
        v += (leaf->ac_ac[lane] * on_ab - leaf->ab_ac[lane] * on_ac) * leaf->over_area[lane];
        w += (leaf->ab_ab[lane] * on_ac - leaf->ab_ac[lane] * on_ab) * leaf->over_area[lane];
        for (int k = 0; k < 3; k++) r[k] = q[k] - leaf->a[k][lane] - v * ab[k] - w * ac[k];
    }
    weights[0] = 1.0 - v - w;
    weights[1] = v;
    weights[2] = w;
    *squared = r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
    return v >= 0.0 && w >= 0.0 && weights[0] >= 0.0;
}

/* Barycentric coordinates of the point of `face` closest to q. Every corner begins one of the edges, where the
 * parameter is exactly 0: corners get weights of exactly 0 and 1. */
static void closest_barycentric(const Tree *tree, int32_t face, const double *q, double *weights)
{
    const Leaf *leaf = &tree->leaves[tree->leaf_of[face]];
    int lane = 0, start = 0;
    while (leaf->face[lane] != face) lane++;
    const double over[3] = {leaf->over_ab[lane], leaf->over_bc[lane], leaf->over_ac[lane]};
    double corners[3][3], least = INFINITY, share = 0.0, squared;
    for (int k = 0; k < 3; k++) {
        corners[0][k] = leaf->a[k][lane];
        corners[1][k] = leaf->b[k][lane];
        corners[2][k] = leaf->c[k][lane];
    }
    for (int i = 0; i < 3; i++) {
        const double *from = corners[i], *to = corners[(i + 1) % 3];
        double along = 0.0, distance = 0.0;
        for (int k = 0; k < 3; k++) along += (q[k] - from[k]) * (to[k] - from[k]);
        double t = clamp01(along * over[i]);
        for (int k = 0; k < 3; k++) {
            double r = q[k] - from[k] - t * (to[k] - from[k]);
            distance += r * r;
        }
        if (i == 0 || distance < least) {
            least = distance;
            share = t;
            start = i;
        }
    }
    if (interior_weights(leaf, lane, q, weights, &squared) && squared < least) return;
    weights[start] = 1.0 - share;
    weights[(start + 1) % 3] = share;
    weights[(start + 2) % 3] = 0.0;
}

/* The point with these weights, from the heaviest corner outwards: exact at corners, precise far from the origin. */
static void face_point(const Tree *tree, int32_t face, const double *weights, double *point)
{
    int heavy = weights[1] > weights[0] ? 1 : 0;
    if (weights[2] > weights[heavy]) heavy = 2;
    int one = (heavy + 1) % 3, two = (heavy + 2) % 3;
    const int32_t *corners = tree->faces + 3 * (int64_t)face;
    const double *h = tree->vertices + 3 * (int64_t)corners[heavy];
    const double *p = tree->vertices + 3 * (int64_t)corners[one], *r = tree->vertices + 3 * (int64_t)corners[two];
    for (int k = 0; k < 3; k++)
        point[k] = h[k] + (weights[one] * (p[k] - h[k]) + weights[two] * (r[k] - h[k]));
}

VECTOR_CLONES
static void closest_rows(const Tree *tree, const double *queries, const int32_t *order, int64_t count,
                         double *points, int32_t *faces, double *weights)
{
    int32_t leaf = 0;
    for (int64_t n = 0; n < count; n++) {
        int64_t row = order[n], ahead = order[n + 12 < count ? n + 12 : n];
        PREFETCH(queries + 3 * ahead); /* sorted queries lie scattered in memory */
        PREFETCH(points + 3 * ahead);
        PREFETCH(weights + 3 * ahead);
        double q[3];
        for (int k = 0; k < 3; k++) q[k] = (queries[3 * row + k] - tree->center[k]) * tree->scale;
        Nearest best = closest_face(tree, q, leaf);
        leaf = tree->leaf_of[best.face]; /* the next query is near this one: a good first upper bound */
        faces[row] = best.face;
        closest_barycentric(tree, best.face, q, weights + 3 * row);
        face_point(tree, best.face, weights + 3 * row, points + 3 * row);
    }
}

INLINE uint32_t spread_bits(uint32_t x)
{
    x = (x | x << 16) & 0x030000FFu;
    x = (x | x << 8) & 0x0300F00Fu;
    x = (x | x << 4) & 0x030C30C3u;
    return (x | x << 2) & 0x09249249u;
}

/* Rows in Morton order of their box (10 bits an axis), by a radix sort of 3 x 10 bits. `scratch` holds 3 * count. */
static void morton_order(const double *rows, int64_t count, int32_t *order, uint32_t *scratch)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, factor[3];
    for (int64_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = rows[3 * i + k] < low[k] ? rows[3 * i + k] : low[k];
            high[k] = rows[3 * i + k] > high[k] ? rows[3 * i + k] : high[k];
        }
    double extent = fmax(fmax(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
    for (int k = 0; k < 3; k++) factor[k] = extent > 0.0 && extent < INFINITY ? 1023.0 / extent : 0.0;
    uint32_t *keys = scratch, *other = scratch + count;
    int32_t *from = (int32_t *)(scratch + 2 * count), *to = order;
    for (int64_t i = 0; i < count; i++) {
        uint32_t key = 0;
        for (int k = 0; k < 3; k++) {
            double cell = (rows[3 * i + k] - low[k]) * factor[k]; /* NaN where the extent overflows */
            key |= spread_bits(cell >= 0.0 && cell <= 1023.0 ? (uint32_t)cell : 0) << k;
        }
        keys[i] = key;
        from[i] = (int32_t)i;
    }
    for (int pass = 0; pass < 3; pass++) {
        int64_t start[1024] = {0}, sum = 0;
        for (int64_t i = 0; i < count; i++) start[keys[i] >> (10 * pass) & 1023]++;
        for (int i = 0; i < 1024; i++) {
            int64_t size = start[i];
            start[i] = sum;
            sum += size;
        }
        for (int64_t i = 0; i < count; i++) {
            int64_t at = start[keys[i] >> (10 * pass) & 1023]++;
            other[at] = keys[i];
            to[at] = from[i];
        }
        uint32_t *keys_swap = keys;
        keys = other;
        other = keys_swap;
        int32_t *swap = from;
        from = to;
        to = swap;
    }
    /* After three passes the order is in `from`, which is `order`. */
}

#endif
