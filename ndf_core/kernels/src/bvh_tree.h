/* The tree: 8 children per node with float32 boxes, leaves of up to 8 triangles in float64, built by binned SAH.
 *
 * Coordinates inside are recentred and scaled by a power of two, so that the mesh fills about [-1, 1]^3 whatever its
 * units: float32 boxes are then precise enough everywhere, and squares neither overflow nor underflow. */
#ifndef NDF_BVH_TREE_H
#define NDF_BVH_TREE_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "compiler.h"

/* gcc vectorises no loop that compares floats while it must keep the order of floating-point traps; nobody reads them
 * here, and results do not change. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("no-trapping-math")
#endif
/* Fused multiply-adds would break the exact agreement between neighbours; gcc makes none under -std=c11. */
#if defined(__clang__) || defined(_MSC_VER)
#pragma STDC FP_CONTRACT OFF
#endif

#define WIDTH 8
#define LANES 8
#define BINS 16
#define MAX_DEPTH 96 /* of binary splits; past 56 they halve the range, and no range is longer than 2^31 */
#define STACK (MAX_DEPTH * (WIDTH - 1) + WIDTH)

#if defined(__GNUC__) && defined(__x86_64__) && defined(__linux__) && defined(__GLIBC__)
#define VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define VECTOR_CLONES
#endif

typedef struct {
    float low[3][WIDTH], high[3][WIDTH]; /* an empty slot has low = +inf, high = -inf */
    int32_t child[WIDTH];                /* a node, or ~leaf */
    int32_t unused[WIDTH];               /* 256 bytes: no box straddles two cache lines */
} Node;

typedef struct {
    double a[3][LANES], b[3][LANES], c[3][LANES];
    double ab_ab[LANES], ab_ac[LANES], ac_ac[LANES];                           /* edge products */
    double over_ab[LANES], over_ac[LANES], over_bc[LANES], over_area[LANES];   /* reciprocals, 0 where degenerate */
    int32_t face[LANES];                                                       /* lanes past `count` repeat lane 0 */
    int32_t count, unused[7];                                                  
} Leaf;

typedef struct {
    float low[3], high[3];
    int32_t face;
} Item;

typedef struct {
    void *node_memory, *leaf_memory;
    Node *nodes;
    Leaf *leaves;
    int32_t *faces;    /* (face_count, 3) */
    double *vertices;  /* as given */
    double *scaled;    /* (vertex - center) * scale */
    int32_t *leaf_of;  /* face -> leaf */
    double center[3], scale;
    double noise;      /* two units in the last place of the largest coordinate, scaled */
    int64_t vertex_count, face_count, node_count, leaf_count;
} Tree;

typedef struct {
    Tree *tree;
    Item *items;
    int64_t node_capacity, leaf_capacity;
    int failed;
} Builder;

INLINE float round_down(double x)
{
    float f = (float)x;
    return (double)f > x ? nextafterf(f, -INFINITY) : f;
}

INLINE float round_up(double x)
{
    float f = (float)x;
    return (double)f < x ? nextafterf(f, INFINITY) : f;
}

static float half_area(const float *low, const float *high)
{
    float x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    return x * y + y * z + z * x;
}

static void items_box(const Item *items, int64_t count, float *low, float *high)
{
    for (int k = 0; k < 3; k++) { low[k] = INFINITY; high[k] = -INFINITY; }
    for (int64_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = items[i].low[k] < low[k] ? items[i].low[k] : low[k];
            high[k] = items[i].high[k] > high[k] ? items[i].high[k] : high[k];
        }
}

typedef struct {
    float low[3], high[3];
    int64_t count;
} Bin;

static void bin_add(Bin *into, const float *low, const float *high, int64_t count)
{
    for (int k = 0; k < 3; k++) {
        into->low[k] = low[k] < into->low[k] ? low[k] : into->low[k];
        into->high[k] = high[k] > into->high[k] ? high[k] : into->high[k];
    }
    into->count += count;
}

static const Bin EMPTY_BIN = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, 0};

static int bin_of(float center, float origin, float factor)
{
    int bin = (int)((center - origin) * factor);
    return bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin;
}

/* What a leaf costs is one vectorised test of LANES triangles, however many of the lanes are filled. */
static float leaf_cost(const Bin *bin)
{
    return half_area(bin->low, bin->high) * (float)((bin->count + LANES - 1) / LANES);
}

/* Partition the items by the cheapest of 3 * (BINS - 1) planes; returns the size of the left part. */
static int64_t split(Item *items, int64_t count, int depth)
{
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int64_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) {
            float middle = items[i].low[k] + items[i].high[k];
            low[k] = middle < low[k] ? middle : low[k];
            high[k] = middle > high[k] ? middle : high[k];
        }
    float best = INFINITY, factor[3];
    int axis = -1, plane = 0;
    Bin bins[3][BINS];
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < BINS; i++) bins[k][i] = EMPTY_BIN;
        factor[k] = high[k] > low[k] ? (float)BINS * 0.9999f / (high[k] - low[k]) : 0.0f;
    }
    for (int64_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            bin_add(&bins[k][bin_of(items[i].low[k] + items[i].high[k], low[k], factor[k])], items[i].low,
                    items[i].high, 1);
    for (int k = 0; k < 3; k++) {
        if (!(high[k] > low[k]) || depth > MAX_DEPTH - 40) continue;
        float right_cost[BINS];
        Bin sum = EMPTY_BIN;
        for (int i = BINS - 1; i > 0; i--) {
            bin_add(&sum, bins[k][i].low, bins[k][i].high, bins[k][i].count);
            right_cost[i] = sum.count ? leaf_cost(&sum) : INFINITY;
        }
        sum = EMPTY_BIN;
        for (int i = 1; i < BINS; i++) {
            bin_add(&sum, bins[k][i - 1].low, bins[k][i - 1].high, bins[k][i - 1].count);
            float cost = sum.count ? leaf_cost(&sum) + right_cost[i] : INFINITY;
            if (cost < best) { best = cost; axis = k; plane = i; }
        }
    }
    if (axis < 0) return count / 2; /* equal centres, or too deep: any halves will do */
    int64_t left = 0, right = count;
    while (left < right) {
        float middle = items[left].low[axis] + items[left].high[axis];
        if (bin_of(middle, low[axis], factor[axis]) < plane) {
            left++;
        } else {
            Item swap = items[left];
            items[left] = items[--right];
            items[right] = swap;
        }
    }
    return left > 0 && left < count ? left : count / 2;
}

static int32_t grow_node(Builder *builder)
{
    Tree *tree = builder->tree;
    if (tree->node_count == builder->node_capacity) {
        int64_t capacity = builder->node_capacity * 2 + 64;
        Node *nodes = realloc(tree->nodes, (size_t)capacity * sizeof(Node));
        if (!nodes) { builder->failed = 1; return -1; }
        tree->nodes = nodes;
        builder->node_capacity = capacity;
    }
    return (int32_t)tree->node_count++;
}

static int32_t grow_leaf(Builder *builder)
{
    Tree *tree = builder->tree;
    if (tree->leaf_count == builder->leaf_capacity) {
        int64_t capacity = builder->leaf_capacity * 2 + 64;
        Leaf *leaves = realloc(tree->leaves, (size_t)capacity * sizeof(Leaf));
        if (!leaves) { builder->failed = 1; return -1; }
        tree->leaves = leaves;
        builder->leaf_capacity = capacity;
    }
    return (int32_t)tree->leaf_count++;
}

INLINE double reciprocal(double x) { return x > 1e-300 ? 1.0 / x : 0.0; }

static void leaf_lane(Leaf *leaf, int lane, const Tree *tree, int32_t face)
{
    const double *a = tree->scaled + 3 * (int64_t)tree->faces[3 * (int64_t)face];
    const double *b = tree->scaled + 3 * (int64_t)tree->faces[3 * (int64_t)face + 1];
    const double *c = tree->scaled + 3 * (int64_t)tree->faces[3 * (int64_t)face + 2];
    double ab_ab = 0, ab_ac = 0, ac_ac = 0, bc_bc = 0, ab[3], ac[3];
    for (int k = 0; k < 3; k++) {
        leaf->a[k][lane] = a[k];
        leaf->b[k][lane] = b[k];
        leaf->c[k][lane] = c[k];
        ab[k] = b[k] - a[k];
        ac[k] = c[k] - a[k];
        ab_ab += ab[k] * ab[k];
        ab_ac += ab[k] * ac[k];
        ac_ac += ac[k] * ac[k];
        bc_bc += (c[k] - b[k]) * (c[k] - b[k]);
    }
    /* |ab x ac|^2 from the cross product: ab_ab * ac_ac - ab_ac^2 cancels for slivers. */
    double x = ab[1] * ac[2] - ab[2] * ac[1], y = ab[2] * ac[0] - ab[0] * ac[2], z = ab[0] * ac[1] - ab[1] * ac[0];
    double area = x * x + y * y + z * z;
    double longest = ab_ab > ac_ac ? ab_ab : ac_ac;
    leaf->ab_ab[lane] = ab_ab;
    leaf->ab_ac[lane] = ab_ac;
    leaf->ac_ac[lane] = ac_ac;
    leaf->over_ab[lane] = reciprocal(ab_ab);
    leaf->over_ac[lane] = reciprocal(ac_ac);
    leaf->over_bc[lane] = reciprocal(bc_bc);
    leaf->over_area[lane] = area > 1e-28 * longest * longest ? reciprocal(area) : 0.0;
    leaf->face[lane] = face;
}

static int32_t make_leaf(Builder *builder, int64_t start, int64_t count)
{
    int32_t index = grow_leaf(builder);
    if (index < 0) return 0;
    Leaf *leaf = &builder->tree->leaves[index];
    memset(leaf, 0, sizeof *leaf);
    leaf->count = (int32_t)count;
    for (int lane = 0; lane < LANES; lane++) {
        int32_t face = builder->items[start + (lane < count ? lane : 0)].face;
        leaf_lane(leaf, lane, builder->tree, face);
        builder->tree->leaf_of[face] = index;
    }
    return ~index;
}

typedef struct {
    int64_t start, count;
    float low[3], high[3];
    int depth;
} Range;

/* Open the child with the largest surface until there are WIDTH of them, or all are small enough to be leaves. */
static int open_children(Builder *builder, Range *children)
{
    int count = 1;
    while (count < WIDTH) {
        int widest = -1;
        float area = -1.0f;
        for (int i = 0; i < count; i++)
            if (children[i].count > LANES && half_area(children[i].low, children[i].high) > area) {
                area = half_area(children[i].low, children[i].high);
                widest = i;
            }
        if (widest < 0) break;
        Range *left = &children[widest], *right = &children[count++];
        int64_t middle = split(builder->items + left->start, left->count, left->depth);
        *right = (Range){.start = left->start + middle, .count = left->count - middle, .depth = ++left->depth};
        left->count = middle;
        items_box(builder->items + left->start, left->count, left->low, left->high);
        items_box(builder->items + right->start, right->count, right->low, right->high);
    }
    return count;
}

static int32_t build_node(Builder *builder, Range range)
{
    Range children[WIDTH];
    children[0] = range;
    int count = open_children(builder, children);
    int32_t index = grow_node(builder);
    if (index < 0) return 0;
    for (int i = 0; i < WIDTH; i++) {
        int32_t child = 0;
        if (i < count && !builder->failed)
            child = children[i].count <= LANES ? make_leaf(builder, children[i].start, children[i].count)
                                               : build_node(builder, children[i]);
        Node *node = &builder->tree->nodes[index]; /* after the recursion, which may move the nodes */
        node->child[i] = child;
        node->unused[i] = 0;
        for (int k = 0; k < 3; k++) {
            node->low[k][i] = i < count ? children[i].low[k] : INFINITY;
            node->high[k][i] = i < count ? children[i].high[k] : -INFINITY;
        }
    }
    return index;
}

static void *aligned_copy(const void *from, size_t size, void **memory)
{
    *memory = malloc(size + 64);
    if (!*memory) return NULL;
    void *aligned = (void *)(((uintptr_t)*memory + 63) & ~(uintptr_t)63);
    memcpy(aligned, from, size);
    return aligned;
}

static void tree_free(Tree *tree)
{
    if (!tree) return;
    free(tree->node_memory);
    free(tree->leaf_memory);
    free(tree->faces);
    free(tree->vertices);
    free(tree->scaled);
    free(tree->leaf_of);
    free(tree);
}

/* The centre is rounded to 1/256 of the extent, so that coordinates with few digits stay exact. */
static void choose_frame(Tree *tree)
{
    double extent = 0.0, low[3], high[3];
    for (int k = 0; k < 3; k++) { low[k] = INFINITY; high[k] = -INFINITY; }
    for (int64_t i = 0; i < 3 * tree->face_count; i++)
        for (int k = 0; k < 3; k++) {
            double x = tree->vertices[3 * (int64_t)tree->faces[i] + k];
            low[k] = x < low[k] ? x : low[k];
            high[k] = x > high[k] ? x : high[k];
        }
    for (int k = 0; k < 3; k++) extent = high[k] - low[k] > extent ? high[k] - low[k] : extent;
    int exponent = 0;
    if (extent > 0.0) frexp(extent, &exponent);
    exponent = exponent < -1000 ? -1000 : exponent; /* the inverse must stay finite */
    double grain = ldexp(1.0, exponent - 8);
    for (int k = 0; k < 3; k++) {
        double middle = low[k] + 0.5 * (high[k] - low[k]), steps = middle / grain;
        tree->center[k] = fabs(steps) < 4503599627370496.0 ? floor(steps) * grain : middle;
    }
    tree->scale = ldexp(1.0, -exponent);
    double largest = 0.0;
    for (int k = 0; k < 3; k++) largest = fmax(largest, fmax(fabs(low[k]), fabs(high[k])));
    tree->noise = 2.0 * DBL_EPSILON * largest * tree->scale;
    for (int64_t i = 0; i < 3 * tree->vertex_count; i++)
        tree->scaled[i] = (tree->vertices[i] - tree->center[i % 3]) * tree->scale;
}

static Item *make_items(const Tree *tree)
{
    Item *items = malloc((size_t)tree->face_count * sizeof(Item));
    if (!items) return NULL;
    for (int64_t f = 0; f < tree->face_count; f++) {
        items[f].face = (int32_t)f;
        for (int k = 0; k < 3; k++) {
            double low = INFINITY, high = -INFINITY;
            for (int corner = 0; corner < 3; corner++) {
                double x = tree->scaled[3 * (int64_t)tree->faces[3 * f + corner] + k];
                low = x < low ? x : low;
                high = x > high ? x : high;
            }
            items[f].low[k] = round_down(low);
            items[f].high[k] = round_up(high);
        }
    }
    return items;
}

/* Indices are validated by the caller. Returns NULL when memory runs out. */
static Tree *tree_build(const double *vertices, int64_t vertex_count, const int32_t *faces, int64_t face_count)
{
    Tree *tree = calloc(1, sizeof *tree);
    if (!tree) return NULL;
    tree->vertex_count = vertex_count;
    tree->face_count = face_count;
    tree->faces = malloc((size_t)face_count * 3 * sizeof(int32_t));
    tree->vertices = malloc((size_t)vertex_count * 3 * sizeof(double));
    tree->scaled = malloc((size_t)vertex_count * 3 * sizeof(double));
    tree->leaf_of = malloc((size_t)face_count * sizeof(int32_t));
    Builder builder = {.tree = tree};
    if (tree->faces && tree->vertices && tree->scaled && tree->leaf_of) {
        memcpy(tree->faces, faces, (size_t)face_count * 3 * sizeof(int32_t));
        memcpy(tree->vertices, vertices, (size_t)vertex_count * 3 * sizeof(double));
        choose_frame(tree);
        builder.items = make_items(tree);
    }
    if (!builder.items) { tree_free(tree); return NULL; }
    Range all = {.start = 0, .count = face_count, .depth = 0};
    items_box(builder.items, face_count, all.low, all.high);
    build_node(&builder, all);
    free(builder.items);
    Node *nodes = tree->nodes;
    Leaf *leaves = tree->leaves;
    tree->nodes = nodes ? aligned_copy(nodes, (size_t)tree->node_count * sizeof(Node), &tree->node_memory) : NULL;
    tree->leaves = leaves ? aligned_copy(leaves, (size_t)tree->leaf_count * sizeof(Leaf), &tree->leaf_memory) : NULL;
    free(nodes);
    free(leaves);
    if (builder.failed || !tree->nodes || !tree->leaves) { tree_free(tree); return NULL; }
    return tree;
}

#endif
