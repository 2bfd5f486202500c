/* What compilers spell differently. */
#ifndef NDF_COMPILER_H
#define NDF_COMPILER_H

#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#define PREFETCH(address) __builtin_prefetch(address)
#else
#define INLINE static inline
#define PREFETCH(address) ((void)(address))
#endif

#endif
