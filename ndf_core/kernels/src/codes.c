/* Entropy coding of quantised arrays: a range coder under an adaptive logistic model, in integers only, so that every
 * machine writes and reads the same bytes.
 *
 * The codes of trained features and weights are bell-shaped, and each column (a feature, an input of a layer) has a
 * scale of its own. The model of a code is a discretised logistic distribution whose scale is the mean magnitude of
 * the codes already seen in its column; nothing but the mean of the whole array is stored. Codes far out in the tails
 * are escaped. Arrays with large codes send their low bits as they are: nothing can be predicted about them.
 */
#include "arrays.h"
#include <stdlib.h>

#define TOTAL_BITS 18
#define TOTAL (1u << TOTAL_BITS)
#define TOP (1u << 24)
#define KNOTS 256 /* of the logistic function's table, 16 to the unit */
#define MEAN_UNIT 16
#define PRIOR 4 /* how many codes the mean of the array counts for in the mean of a column */
#define MEAN_BITS 12
#define SHIFT_BITS 4
#define END_ZEROS 4 /* of the last four bytes at least three are zero */

typedef struct {
    int64_t half[KNOTS + 1]; /* 2^31 * (logistic(j / 16) - 1/2) */
} Logistic;

/* e^(-j/16) by repeated multiplication with floor(2^32 e^(-1/16)): integers, hence the same everywhere. */
static void logistic_fill(Logistic *table)
{
    uint64_t power = 1ull << 32;
    for (int j = 0; j <= KNOTS; j++) {
        table->half[j] = (int64_t)((1ull << 63) / ((1ull << 32) + power)) - (1ll << 30);
        power = power * 4034748382ull >> 32;
    }
}

/* The model of one code: `inverse` is 2^16 table steps per half unit, `reach` the largest magnitude not escaped. */
typedef struct {
    const Logistic *table;
    uint64_t inverse;
    int64_t reach;
} Model;

static Model model_at(const Logistic *table, int64_t sum, int64_t count)
{
    if (sum < 2 * count)
        sum = 2 * count; /* a mean magnitude of 1/8 at least */
    /* 726817 = 2^16 * 16 * ln 2: the mean magnitude of a logistic variable is 2 ln 2 times its scale */
    Model model = {table, (uint64_t)(726817 * MEAN_UNIT * count / sum), 8 * sum / (MEAN_UNIT * count) + 15};
    if (model.reach > 32768)
        model.reach = 32768;
    return model;
}

/* How many of the TOTAL slots lie below `code`; strictly increasing over -reach .. reach + 1. */
static uint32_t slots_below(const Model *model, int64_t code)
{
    if (code <= -model->reach)
        return 0;
    if (code > model->reach)
        return TOTAL - 1; /* the last slot is the escape */
    int64_t edge = 2 * code - 1;
    uint64_t place = (uint64_t)(edge < 0 ? -edge : edge) * model->inverse;
    int64_t half = model->table->half[KNOTS];
    if (place >> 16 < KNOTS) {
        int64_t left = model->table->half[place >> 16], right = model->table->half[(place >> 16) + 1];
        half = left + ((right - left) * (int64_t)(place & 0xffff) >> 16);
    }
    int64_t spread = TOTAL - (2 * model->reach + 2); /* every code keeps one slot of its own besides */
    int64_t below = (1ll << 30) + (edge < 0 ? -half : half);
    return (uint32_t)((below * spread >> 31) + code + model->reach);
}

typedef struct {
    uint64_t low;
    uint32_t range;
    uint8_t cache;
    Py_ssize_t pending, size, capacity; /* `size` may pass `capacity`; what does not fit is dropped */
    uint8_t *bytes;
} Encoder;

static void put_byte(Encoder *coder, uint8_t byte)
{
    if (coder->size >= 0 && coder->size < coder->capacity)
        coder->bytes[coder->size] = byte;
    coder->size++;
}

/* The top byte of `low` leaves once no carry can reach it. The very first one is always zero: size starts at -1. */
static void shift_low(Encoder *coder)
{
    if (coder->low < 0xff000000ull || coder->low >> 32) {
        uint8_t carry = (uint8_t)(coder->low >> 32);
        put_byte(coder, coder->cache + carry);
        for (; coder->pending; coder->pending--)
            put_byte(coder, 0xff + carry);
        coder->cache = (uint8_t)(coder->low >> 24);
    } else {
        coder->pending++;
    }
    coder->low = (coder->low & 0xffffff) << 8;
}

static void encode_slots(Encoder *coder, uint32_t below, uint32_t slots, int bits)
{
    coder->range >>= bits;
    coder->low += (uint64_t)below * coder->range;
    coder->range *= slots;
    while (coder->range < TOP) {
        coder->range <<= 8;
        shift_low(coder);
    }
}

/* Of all numbers in [low, low + range) take the one with the most trailing zeros; the reader supplies up to END_ZEROS
 * of them itself. */
static Py_ssize_t encode_end(Encoder *coder)
{
    coder->low = (coder->low + TOP - 1) & ~(uint64_t)(TOP - 1);
    for (int i = 0; i < 5; i++)
        shift_low(coder);
    if (coder->size > coder->capacity)
        return -1;
    for (int i = 0; i < END_ZEROS && coder->bytes[coder->size - 1] == 0; i++)
        coder->size--;
    return coder->size;
}

typedef struct {
    uint32_t range, code;
    Py_ssize_t position, size;
    const uint8_t *bytes;
} Decoder;

static void take_byte(Decoder *coder)
{
    uint8_t byte = coder->position < coder->size ? coder->bytes[coder->position] : 0;
    coder->position++;
    coder->code = coder->code << 8 | byte;
}

static uint32_t decode_target(Decoder *coder, int bits)
{
    coder->range >>= bits;
    uint32_t target = coder->code / coder->range;
    return target >> bits ? (1u << bits) - 1 : target; /* only in a stream that no encoder wrote */
}

static void decode_slots(Decoder *coder, uint32_t below, uint32_t slots)
{
    coder->code -= below * coder->range;
    coder->range *= slots;
    while (coder->range < TOP) {
        coder->range <<= 8;
        take_byte(coder);
    }
}

static uint32_t decode_bits(Decoder *coder, int bits)
{
    uint32_t value = decode_target(coder, bits);
    decode_slots(coder, value, 1);
    return value;
}

static int64_t decode_code(Decoder *coder, const Model *model)
{
    uint32_t target = decode_target(coder, TOTAL_BITS);
    if (target == TOTAL - 1) {
        decode_slots(coder, target, 1);
        return (int64_t)decode_bits(coder, 16) - 32768;
    }
    int64_t low = -model->reach, high = model->reach + 1;
    while (high - low > 1) {
        int64_t middle = low + (high - low) / 2;
        if (slots_below(model, middle) <= target)
            low = middle;
        else
            high = middle;
    }
    uint32_t below = slots_below(model, low);
    decode_slots(coder, below, slots_below(model, low + 1) - below);
    return low;
}

static int64_t magnitude(int64_t value) { return value < 0 ? -value : value; }

/* Smallest number of low bits to split off that leaves a mean magnitude of at most 128, and that mean in 1/16. */
static int64_t mean_and_shift(const int32_t *codes, Py_ssize_t count, int *shift)
{
    for (*shift = 0;; (*shift)++) {
        int64_t sum = 0;
        for (Py_ssize_t i = 0; i < count; i++)
            sum += magnitude(codes[i] >> *shift);
        int64_t mean = (sum * MEAN_UNIT + count - 1) / count;
        if (mean <= 128 * MEAN_UNIT)
            return mean;
    }
}

static void encode_array(Encoder *coder, const Logistic *table, const int32_t *codes, Py_ssize_t rows,
                         Py_ssize_t columns, int64_t *sums)
{
    int shift;
    int64_t mean = mean_and_shift(codes, rows * columns, &shift);
    encode_slots(coder, (uint32_t)shift, 1, SHIFT_BITS);
    encode_slots(coder, (uint32_t)mean, 1, MEAN_BITS);
    for (Py_ssize_t j = 0; j < columns; j++)
        sums[j] = PRIOR * mean;
    for (Py_ssize_t i = 0; i < rows; i++)
        for (Py_ssize_t j = 0; j < columns; j++, codes++) {
            Model model = model_at(table, sums[j], PRIOR + i);
            int64_t code = *codes >> shift;
            if (magnitude(code) > model.reach) {
                encode_slots(coder, TOTAL - 1, 1, TOTAL_BITS);
                encode_slots(coder, (uint32_t)(code + 32768), 1, 16);
            } else {
                uint32_t below = slots_below(&model, code);
                encode_slots(coder, below, slots_below(&model, code + 1) - below, TOTAL_BITS);
            }
            if (shift)
                encode_slots(coder, (uint32_t)*codes & ((1u << shift) - 1), 1, shift);
            sums[j] += MEAN_UNIT * magnitude(code);
        }
}

static void decode_array(Decoder *coder, const Logistic *table, int32_t *codes, Py_ssize_t rows, Py_ssize_t columns,
                         int64_t *sums)
{
    int shift = (int)decode_bits(coder, SHIFT_BITS);
    int64_t mean = decode_bits(coder, MEAN_BITS);
    for (Py_ssize_t j = 0; j < columns; j++)
        sums[j] = PRIOR * mean;
    for (Py_ssize_t i = 0; i < rows; i++)
        for (Py_ssize_t j = 0; j < columns; j++, codes++) {
            Model model = model_at(table, sums[j], PRIOR + i);
            int64_t code = decode_code(coder, &model);
            sums[j] += MEAN_UNIT * magnitude(code);
            int64_t value = code * (1 << shift) + (shift ? decode_bits(coder, shift) : 0);
            *codes = (int32_t)(value < -32768 ? -32768 : value > 32767 ? 32767 : value);
        }
}

/* Check the shapes (k, 2) against the number of codes; returns the widest array's columns, or -1 with an error set. */
static Py_ssize_t widest_array(const Array *shapes, Py_ssize_t codes)
{
    const int32_t *shape = shapes->data;
    Py_ssize_t widest = 1, total = 0;
    for (Py_ssize_t k = 0; k < shapes->rows; k++, shape += 2) {
        if (shape[0] < 1 || shape[1] < 1) {
            PyErr_SetString(PyExc_ValueError, "shapes: every array needs at least one row and one column");
            return -1;
        }
        total += (Py_ssize_t)shape[0] * shape[1];
        if (shape[1] > widest)
            widest = shape[1];
        if (total > codes)
            break;
    }
    if (total != codes) {
        PyErr_SetString(PyExc_ValueError, "shapes: do not add up to the number of codes");
        return -1;
    }
    return widest;
}

static const int COLUMNS[] = {1, 1, 2};

/* encode(bytes B(capacity,), codes i(n,), shapes i(k,2)) -> size, or -1 where the capacity does not do */
static PyObject *encode(PyObject *self, PyObject *args)
{
    PyObject *objects[3], *result = NULL;
    Arrays held;
    static const char *const names[] = {"bytes", "codes", "shapes"};
    int64_t *sums = NULL;
    if (!PyArg_ParseTuple(args, "OOO", &objects[0], &objects[1], &objects[2])
        || arrays_get(&held, objects, "Bii", COLUMNS, names, 1) < 0)
        return NULL;
    Array *arrays = held.array;
    Py_ssize_t widest = widest_array(&arrays[2], arrays[1].rows);
    if (widest < 0)
        goto done;
    const int32_t *codes = arrays[1].data, *shape = arrays[2].data;
    for (Py_ssize_t i = 0; i < arrays[1].rows; i++)
        if (codes[i] < -32768 || codes[i] > 32767) {
            PyErr_SetString(PyExc_ValueError, "codes: outside the range of int16");
            goto done;
        }
    sums = malloc(sizeof *sums * (size_t)widest);
    if (!sums) {
        PyErr_NoMemory();
        goto done;
    }
    Encoder coder = {.range = 0xffffffffu, .size = -1, .capacity = arrays[0].rows, .bytes = arrays[0].data};
    Logistic table;
    Py_BEGIN_ALLOW_THREADS
    logistic_fill(&table);
    for (Py_ssize_t k = 0; k < arrays[2].rows; codes += (Py_ssize_t)shape[2 * k] * shape[2 * k + 1], k++)
        encode_array(&coder, &table, codes, shape[2 * k], shape[2 * k + 1], sums);
    Py_END_ALLOW_THREADS
    result = PyLong_FromSsize_t(encode_end(&coder));
done:
    free(sums);
    arrays_release(&held);
    return result;
}

/* decode(codes i(n,), bytes B(m,), shapes i(k,2)) -> whether the stream ends where the last code does */
static PyObject *decode(PyObject *self, PyObject *args)
{
    PyObject *objects[3], *result = NULL;
    Arrays held;
    static const char *const names[] = {"codes", "bytes", "shapes"};
    int64_t *sums = NULL;
    if (!PyArg_ParseTuple(args, "OOO", &objects[0], &objects[1], &objects[2])
        || arrays_get(&held, objects, "iBi", COLUMNS, names, 1) < 0)
        return NULL;
    Array *arrays = held.array;
    Py_ssize_t widest = widest_array(&arrays[2], arrays[0].rows);
    if (widest < 0)
        goto done;
    sums = malloc(sizeof *sums * (size_t)widest);
    if (!sums) {
        PyErr_NoMemory();
        goto done;
    }
    Decoder coder = {.range = 0xffffffffu, .size = arrays[1].rows, .bytes = arrays[1].data};
    int32_t *codes = arrays[0].data;
    const int32_t *shape = arrays[2].data;
    Logistic table;
    Py_BEGIN_ALLOW_THREADS
    logistic_fill(&table);
    for (int i = 0; i < 4; i++)
        take_byte(&coder);
    for (Py_ssize_t k = 0; k < arrays[2].rows; codes += (Py_ssize_t)shape[2 * k] * shape[2 * k + 1], k++)
        decode_array(&coder, &table, codes, shape[2 * k], shape[2 * k + 1], sums);
    Py_END_ALLOW_THREADS
    result = PyBool_FromLong(coder.size <= coder.position && coder.position <= coder.size + END_ZEROS);
done:
    free(sums);
    arrays_release(&held);
    return result;
}

static PyMethodDef methods[] = {
    {"encode", encode, METH_VARARGS, "Encode arrays of int16 codes."},
    {"decode", decode, METH_VARARGS, "Decode arrays of int16 codes."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_codes", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__codes(void) { return PyModule_Create(&module); }
