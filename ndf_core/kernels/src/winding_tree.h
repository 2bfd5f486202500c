/* The tree behind fast winding numbers: 8 children per node, each with the multipole moments of its sources.
 *
 * w(q) = 1/(4 pi) sum_i A_i . (x_i - q) / |x_i - q|^3 over the sources' area vectors A_i: -1/(4 pi) A . grad phi with
 * phi(r) = 1/|r|. About a centre c, with r = c - q and d = x_i - c, the Taylor series of grad phi sees only
 *     M1 = sum A,   M2 = sum A d^T,   M3 = sum A d d^T / 2
 * and, since all derivatives of phi are symmetric and traceless, only the symmetric traceless parts of those. Then
 *     4 pi w = M1.r / r^3 - 3 M2:rr / r^5 + 15 M3:rrr / r^7.
 * Coordinates inside are recentred and scaled, so that the sources fill about [-1, 1]^3; float32 holds them.
 *
 * Reference: Barill, Dickson, Schmidt, Levin and Jacobson, Fast winding numbers for soups and clouds, 2018. */
#ifndef NDF_WINDING_TREE_H
#define NDF_WINDING_TREE_H

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "compiler.h"

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("no-trapping-math", "fp-contract=fast")
#endif
#if defined(__GNUC__) && defined(__x86_64__) && defined(__linux__) && defined(__GLIBC__)
#define VECTOR_CLONES __attribute__((target_clones("avx512f", "arch=haswell", "default")))
#else
#define VECTOR_CLONES
#endif

#define LANES 8
#define DEPTH 16 /* of nodes: 8^16 sources are more than there can be */
#define STACK (DEPTH * LANES)

typedef struct {
    float center[3][LANES];
    float beyond[LANES]; /* squared distance from which the moments may stand for the sources */
    float m1[3][LANES];
    float m2[5][LANES];  /* xx yy xy xz yz; zz = -xx - yy */
    float m3[7][LANES];  /* xxx yyy xxy xyy xxz yyz xyz; the other three from the traces */
    int32_t child[LANES]; /* a node, or ~leaf */
} Node;

/* Up to 8 sources; the lanes past the last one have no area. */
typedef struct {
    float a[3][LANES];    /* points, or first corners */
    float area[3][LANES]; /* area vectors; of triangles twice those */
    union {
        float radius[LANES];               /* of the ball that a point's dipole is spread over */
        struct {
            float b[3][LANES], c[3][LANES];
        }; /* the other corners of triangles */
    };
} Leaf;
#define POINT_LEAF_BYTES (offsetof(Leaf, radius) + LANES * sizeof(float)) /* the rest is for triangles */

typedef struct {
    Node *nodes;
    char *leaves; /* of `leaf_bytes` each: points need less of a Leaf than triangles */
    size_t leaf_bytes;
    int64_t node_count, leaf_count;
    int triangles;
    double center[3], scale; /* inside = (outside - center) * scale */
} Tree;

typedef struct {
    const double *corners; /* 9 per triangle, 3 per point; scaled */
    const double *areas;   /* area vectors; scaled */
    const double *radii;   /* of points; scaled */
    double *middles;       /* 3 per source */
    int32_t *order;
    double beta;
    Tree *tree;
    int64_t node_capacity, leaf_capacity;
    int failed;
} Builder;

INLINE Leaf *leaf_at(const Tree *tree, int64_t index) { return (Leaf *)(tree->leaves + index * tree->leaf_bytes); }

static void tree_free(Tree *tree)
{
    if (!tree) return;
    free(tree->nodes);
    free(tree->leaves);
    free(tree);
}

/* Put the `rank` smallest of order[0 .. count - 1] along an axis first (Hoare's quickselect, ties by index). */
static void select_smallest(const double *middles, int32_t *order, int64_t count, int64_t rank, int axis)
{
    int64_t low = 0, high = count - 1;
    while (low < high) {
        int32_t pivot = order[low + (high - low) / 2];
        double value = middles[3 * (int64_t)pivot + axis];
        int64_t i = low, j = high;
        while (i <= j) {
            for (;; i++) {
                double x = middles[3 * (int64_t)order[i] + axis];
                if (!(x < value || (x == value && order[i] < pivot))) break;
            }
            for (;; j--) {
                double x = middles[3 * (int64_t)order[j] + axis];
                if (!(x > value || (x == value && order[j] > pivot))) break;
            }
            if (i <= j) {
                int32_t swap = order[i];
                order[i++] = order[j];
                order[j--] = swap;
            }
        }
        if (rank <= j) high = j;
        else if (rank >= i) low = i;
        else return;
    }
}

/* Halve a range of sources along the longest side of its middles' box, at a multiple of LANES. */
static int64_t halve(Builder *builder, int64_t start, int64_t count)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int64_t i = start; i < start + count; i++)
        for (int k = 0; k < 3; k++) {
            double x = builder->middles[3 * (int64_t)builder->order[i] + k];
            low[k] = x < low[k] ? x : low[k];
            high[k] = x > high[k] ? x : high[k];
        }
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    int64_t half = (count / 2 + LANES - 1) / LANES * LANES;
    if (half >= count) half = count / 2;
    select_smallest(builder->middles, builder->order + start, count, half, axis);
    return half;
}

/* Moments of a range of sources about their middle, into one lane of a node. */
static void set_moments(const Builder *builder, int64_t start, int64_t count, Node *node, int lane)
{
    const int corner_count = builder->tree->triangles ? 3 : 1;
    double center[3] = {0, 0, 0}, weight = 0, radius = 0, spread = 0;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int64_t i = start; i < start + count; i++) {
        const double *a = builder->areas + 3 * (int64_t)builder->order[i];
        const double *x = builder->middles + 3 * (int64_t)builder->order[i];
        double area = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
        weight += area;
        for (int k = 0; k < 3; k++) {
            center[k] += area * x[k];
            low[k] = x[k] < low[k] ? x[k] : low[k];
            high[k] = x[k] > high[k] ? x[k] : high[k];
        }
    }
    for (int k = 0; k < 3; k++) center[k] = weight > 0 ? center[k] / weight : (low[k] + high[k]) / 2;
    double m1[3] = {0}, m2[3][3] = {{0}}, m3[3][3][3] = {{{0}}};
    for (int64_t i = start; i < start + count; i++) {
        int64_t source = builder->order[i];
        const double *a = builder->areas + 3 * source, *x = builder->middles + 3 * source;
        double d[3], second[3][3];
        for (int k = 0; k < 3; k++) d[k] = x[k] - center[k];
        for (int k = 0; k < 3; k++)
            for (int l = 0; l < 3; l++) second[k][l] = d[k] * d[l];
        for (int corner = 0; corner < corner_count; corner++) {
            const double *p = builder->corners + 3 * (corner_count * source + corner);
            double distance = 0;
            for (int k = 0; k < 3; k++) distance += (p[k] - center[k]) * (p[k] - center[k]);
            radius = distance > radius ? distance : radius;
            /* The second moment of a triangle about its middle is a twelfth of its corners'. */
            if (corner_count == 3)
                for (int k = 0; k < 3; k++)
                    for (int l = 0; l < 3; l++) second[k][l] += (p[k] - x[k]) * (p[l] - x[l]) / 12;
        }
        if (builder->radii) spread = builder->radii[source] > spread ? builder->radii[source] : spread;
        for (int k = 0; k < 3; k++) {
            m1[k] += a[k];
            for (int l = 0; l < 3; l++) {
                m2[k][l] += a[k] * d[l];
                for (int m = 0; m < 3; m++) m3[k][l][m] += a[k] * second[l][m] / 2;
            }
        }
    }
    double s2[3][3], s3[3][3][3], trace3[3] = {0}, trace2 = (m2[0][0] + m2[1][1] + m2[2][2]) / 3;
    for (int k = 0; k < 3; k++)
        for (int l = 0; l < 3; l++) {
            s2[k][l] = (m2[k][l] + m2[l][k]) / 2 - (k == l ? trace2 : 0);
            for (int m = 0; m < 3; m++) s3[k][l][m] = (m3[k][l][m] + m3[l][k][m] + m3[m][k][l]) / 3;
        }
    for (int k = 0; k < 3; k++)
        for (int l = 0; l < 3; l++) trace3[k] += s3[l][l][k] / 5;
    for (int k = 0; k < 3; k++)
        for (int l = 0; l < 3; l++)
            for (int m = 0; m < 3; m++)
                s3[k][l][m] -= (k == l ? trace3[m] : 0) + (k == m ? trace3[l] : 0) + (l == m ? trace3[k] : 0);
    const double flat2[5] = {s2[0][0], s2[1][1], s2[0][1], s2[0][2], s2[1][2]};
    const double flat3[7] = {s3[0][0][0], s3[1][1][1], s3[0][0][1], s3[0][1][1], s3[0][0][2], s3[1][1][2], s3[0][1][2]};
    for (int k = 0; k < 3; k++) {
        node->center[k][lane] = (float)center[k];
        node->m1[k][lane] = (float)m1[k];
    }
    for (int k = 0; k < 5; k++) node->m2[k][lane] = (float)flat2[k];
    for (int k = 0; k < 7; k++) node->m3[k][lane] = (float)flat3[k];
    radius = sqrt(radius);
    /* Beyond its ball a spread dipole is the dipole itself (Newton's shell theorem). */
    double beyond = builder->beta * radius > radius + spread ? builder->beta * radius : radius + spread;
    node->beyond[lane] = (float)(beyond * beyond * (1 + 1e-6)) + 1e-12f;
}

static int64_t make_leaf(Builder *builder, int64_t start, int64_t count)
{
    Tree *tree = builder->tree;
    if (tree->leaf_count == builder->leaf_capacity) {
        int64_t capacity = 2 * builder->leaf_capacity;
        char *grown = realloc(tree->leaves, (size_t)capacity * tree->leaf_bytes);
        if (!grown) {
            builder->failed = 1;
            return 0;
        }
        tree->leaves = grown;
        builder->leaf_capacity = capacity;
    }
    Leaf *leaf = leaf_at(tree, tree->leaf_count);
    memset(leaf, 0, tree->leaf_bytes);
    for (int lane = 0; lane < LANES; lane++) {
        int64_t source = builder->order[start + (lane < count ? lane : 0)];
        for (int k = 0; k < 3; k++) {
            if (tree->triangles) {
                const double *corner = builder->corners + 9 * source;
                leaf->a[k][lane] = (float)corner[k];
                leaf->b[k][lane] = (float)corner[3 + k];
                leaf->c[k][lane] = (float)corner[6 + k];
                leaf->area[k][lane] = lane < count ? (float)(2 * builder->areas[3 * source + k]) : 0;
            } else {
                leaf->a[k][lane] = (float)builder->corners[3 * source + k];
                leaf->area[k][lane] = lane < count ? (float)builder->areas[3 * source + k] : 0;
            }
        }
        if (!tree->triangles) leaf->radius[lane] = (float)builder->radii[source];
    }
    return tree->leaf_count++;
}

/* Cut a range into up to LANES parts by halving the largest, and make a node of them; returns its index. */
static int64_t make_node(Builder *builder, int64_t start, int64_t count)
{
    Tree *tree = builder->tree;
    if (tree->node_count == builder->node_capacity) {
        int64_t capacity = 2 * builder->node_capacity;
        Node *grown = realloc(tree->nodes, (size_t)capacity * sizeof(Node));
        if (!grown) {
            builder->failed = 1;
            return 0;
        }
        tree->nodes = grown;
        builder->node_capacity = capacity;
    }
    int64_t index = tree->node_count++, first[LANES] = {start}, size[LANES] = {count};
    int parts = 1;
    while (parts < LANES) {
        int largest = 0;
        for (int i = 1; i < parts; i++)
            if (size[i] > size[largest]) largest = i;
        if (size[largest] <= LANES) break;
        int64_t half = halve(builder, first[largest], size[largest]);
        first[parts] = first[largest] + half;
        size[parts] = size[largest] - half;
        size[largest] = half;
        parts++;
    }
    Node node;
    memset(&node, 0, sizeof node);
    for (int lane = 0; lane < LANES; lane++) {
        node.beyond[lane] = -1; /* an empty lane has no moments: always far enough */
        for (int k = 0; k < 3; k++) node.center[k][lane] = 8;
        if (lane < parts) set_moments(builder, first[lane], size[lane], &node, lane);
    }
    for (int lane = 0; lane < parts && !builder->failed; lane++)
        node.child[lane] = size[lane] <= LANES ? ~(int32_t)make_leaf(builder, first[lane], size[lane])
                                               : (int32_t)make_node(builder, first[lane], size[lane]);
    if (!builder->failed) tree->nodes[index] = node;
    return index;
}

/* `corners`, `areas` and `radii` (NULL for triangles) are in the frame of [-1, 1]^3 already. */
static Tree *tree_build(const double *corners, const double *areas, const double *radii, int64_t count, double beta)
{
    Builder builder = {corners, areas, radii, NULL, NULL, beta, NULL, count / LANES + 16, count / LANES + 16, 0};
    Tree *tree = calloc(1, sizeof *tree);
    builder.tree = tree;
    builder.middles = malloc((size_t)count * 3 * sizeof(double));
    builder.order = malloc((size_t)count * sizeof(int32_t));
    if (tree) {
        tree->triangles = radii == NULL;
        tree->leaf_bytes = tree->triangles ? sizeof(Leaf) : POINT_LEAF_BYTES;
        tree->nodes = malloc((size_t)builder.node_capacity * sizeof(Node));
        tree->leaves = malloc((size_t)builder.leaf_capacity * tree->leaf_bytes);
    }
    if (!tree || !builder.middles || !builder.order || !tree->nodes || !tree->leaves) {
        builder.failed = 1;
    } else {
        for (int64_t i = 0; i < count; i++) {
            builder.order[i] = (int32_t)i;
            for (int k = 0; k < 3; k++)
                builder.middles[3 * i + k] =
                    radii ? corners[3 * i + k]
                          : (corners[9 * i + k] + corners[9 * i + 3 + k] + corners[9 * i + 6 + k]) / 3;
        }
        make_node(&builder, 0, count);
    }
    free(builder.middles);
    free(builder.order);
    if (builder.failed) {
        tree_free(tree);
        return NULL;
    }
    return tree;
}

#endif
