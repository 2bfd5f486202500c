/* The tile loops of field.c, included once for each instruction set with NAME, TARGET, VECTOR_BYTES, ROWS, VECTORS set:
 * ROWS * VECTORS sums fill its registers without spilling. */

/* sin and cos of frequency * x. The argument stays in double until it is reduced: at the highest levels it reaches
 * hundreds of radians, where float32 would lose three digits. q = n pi + r with |r| <= pi/2, so that
 * sin q = (-1)^n sin r, and Taylor series to degrees 13 and 12 leave 7e-10 and 7e-9. */
static TARGET void NAME(encode_level)(const double *x, double frequency, float *sines, float *cosines)
{
    const double round_to_integer = 6755399441055744.0; /* 1.5 * 2^52 */
    for (int t = 0; t < TILE; t++) {
        double q = frequency * x[t];
        double n = q * 0.31830988618379067154 + round_to_integer - round_to_integer;
        double odd = n - 2.0 * (0.5 * n + round_to_integer - round_to_integer);
        float sign = (float)(1.0 - 2.0 * fabs(odd));
        float r = (float)((q - n * 3.1415926535897931160) - n * 1.2246467991473532072e-16);
        float s = r * r;
        float sine = 1.6059043836821613e-10f;
        sine = sine * s - 2.505210838544172e-8f;
        sine = sine * s + 2.7557319223985893e-6f;
        sine = sine * s - 1.984126984126984e-4f;
        sine = sine * s + 8.333333333333333e-3f;
        sine = sine * s - 1.6666666666666666e-1f;
        float cosine = 2.08767569878681e-9f;
        cosine = cosine * s - 2.7557319223985888e-7f;
        cosine = cosine * s + 2.48015873015873e-5f;
        cosine = cosine * s - 1.388888888888889e-3f;
        cosine = cosine * s + 4.1666666666666664e-2f;
        cosine = cosine * s - 0.5f;
        sines[t] = sign * (r + r * s * sine);
        cosines[t] = sign * (1.0f + s * cosine);
    }
}

#if VECTOR_BYTES > 4
typedef float NAME(Vector) __attribute__((vector_size(VECTOR_BYTES), may_alias));
typedef int32_t NAME(Mask) __attribute__((vector_size(VECTOR_BYTES)));
#define ZERO ((NAME(Vector)){0})
#define RELU(v) ((NAME(Vector))((NAME(Mask))(v) & ((v) > 0)))
#else
typedef float NAME(Vector);
#define ZERO 0.0f
#define RELU(v) ((v) > 0 ? (v) : 0)
#endif
#define LANES (VECTOR_BYTES / 4)

/* ROWS rows of a weight matrix, starting at row `first` of a packed BLOCK, held in registers against VECTORS vectors
 * of samples at a time. */
static TARGET void NAME(dense_rows)(const float *weights, const float *biases, const float *input, float *output,
                                    Py_ssize_t inputs, Py_ssize_t first, int relu)
{
    for (int t = 0; t < TILE; t += LANES * VECTORS) {
        NAME(Vector) sum[ROWS][VECTORS];
        UNROLL for (int r = 0; r < ROWS; r++)
            UNROLL for (int l = 0; l < VECTORS; l++)
                sum[r][l] = ZERO + biases[first + r];
        for (Py_ssize_t i = 0; i < inputs; i++) {
            const NAME(Vector) *in = (const NAME(Vector) *)(input + i * TILE + t);
            const float *w = weights + i * BLOCK + first;
            UNROLL for (int l = 0; l < VECTORS; l++)
                UNROLL for (int r = 0; r < ROWS; r++)
                    sum[r][l] += in[l] * w[r];
        }
        UNROLL for (int r = 0; r < ROWS; r++)
            UNROLL for (int l = 0; l < VECTORS; l++) {
                NAME(Vector) value = sum[r][l];
                *(NAME(Vector) *)(output + (first + r) * TILE + t + LANES * l) = relu ? RELU(value) : value;
            }
    }
}

static TARGET void NAME(dense)(const float *packed, Py_ssize_t inputs, Py_ssize_t outputs, const float *input,
                               float *output, int relu)
{
    const float *weights = packed + padded(outputs);
    for (Py_ssize_t o = 0; o < outputs; o += BLOCK, weights += inputs * BLOCK)
        for (int first = 0; first < BLOCK && o + first < outputs; first += ROWS)
            NAME(dense_rows)(weights, packed + o, input, output + o * TILE, inputs, first, relu);
}

/* Positions of one tile, [3][TILE], in float64: the rounding to float32 happens once, at the end. */
static TARGET void NAME(locate)(const Queries *queries, Py_ssize_t start, int count, double *position)
{
    for (int t = 0; t < TILE; t++) {
        Py_ssize_t row = start + (t < count ? t : 0);
        if (queries->points) {
            for (int c = 0; c < 3; c++)
                position[c * TILE + t] = queries->points[3 * row + c];
            continue;
        }
        const int32_t *corner = queries->base_faces + 3 * (Py_ssize_t)queries->faces[row];
        const double *w = queries->barycentric + 3 * row;
        for (int c = 0; c < 3; c++)
            position[c * TILE + t] = w[0] * queries->vertices[3 * (Py_ssize_t)corner[0] + c]
                                   + w[1] * queries->vertices[3 * (Py_ssize_t)corner[1] + c]
                                   + w[2] * queries->vertices[3 * (Py_ssize_t)corner[2] + c];
    }
}

static TARGET void NAME(gather)(const Queries *queries, const Network *net, Py_ssize_t start, int count, float *output)
{
    const Py_ssize_t d = net->feature_dim;
    for (int t = 0; t < TILE; t++) {
        Py_ssize_t row = start + (t < count ? t : 0);
        const int32_t *corner = queries->base_faces + 3 * (Py_ssize_t)queries->faces[row];
        const double *w = queries->barycentric + 3 * row;
        const float w0 = (float)w[0], w1 = (float)w[1], w2 = (float)w[2];
        const float *f0 = net->features + d * corner[0], *f1 = net->features + d * corner[1];
        const float *f2 = net->features + d * corner[2];
        for (Py_ssize_t j = 0; j < d; j++)
            output[j * TILE + t] = w0 * f0[j] + w1 * f1[j] + w2 * f2[j];
    }
}

static TARGET void NAME(run_tile)(const Network *net, const Queries *queries, Py_ssize_t start, int count, float *answer,
                                  float *scratch)
{
    float *current = scratch, *next = scratch + net->widest * TILE;
    double position[3 * TILE];
    NAME(locate)(queries, start, count, position);
    float *input = current;
    if (net->include_position)
        for (int i = 0; i < 3 * TILE; i++)
            *input++ = (float)position[i];
    double frequency = net->base_frequency;
    for (Py_ssize_t k = 0; k < net->levels; k++, frequency *= 2.0, input += 6 * TILE)
        for (int c = 0; c < 3; c++)
            NAME(encode_level)(position + c * TILE, frequency, input + c * TILE, input + (3 + c) * TILE);
    if (net->feature_dim)
        NAME(gather)(queries, net, start, count, input);
    const float *packed = net->packed;
    for (Py_ssize_t i = 0; i < net->layers; i++) {
        Py_ssize_t inputs = net->width[i], outputs = net->width[i + 1];
        NAME(dense)(packed, inputs, outputs, current, next, i + 1 < net->layers);
        packed += padded(outputs) * (1 + inputs);
        float *swap = current;
        current = next;
        next = swap;
    }
    const Py_ssize_t k = net->width[net->layers];
    for (int t = 0; t < count; t++)
        for (Py_ssize_t o = 0; o < k; o++)
            answer[(start + t) * k + o] = net->residual ? (float)((double)current[o * TILE + t] + position[o * TILE + t])
                                                        : current[o * TILE + t];
}

static TARGET void NAME(run)(const Network *net, const Queries *queries, Py_ssize_t count, float *answer,
                             float *scratch)
{
    for (Py_ssize_t start = 0; start < count; start += TILE)
        NAME(run_tile)(net, queries, start, (int)(count - start < TILE ? count - start : TILE), answer, scratch);
}

#undef LANES
#undef RELU
#undef ZERO
#undef VECTORS
#undef ROWS
#undef VECTOR_BYTES
#undef TARGET
#undef NAME
