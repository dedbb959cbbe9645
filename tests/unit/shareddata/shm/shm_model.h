/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Before every file of the store in shared memory, as test_shareddata_shm_model is made of them: each load,
 * store and fence of shared words, the writers' lock and the futex go to the test. The store's own sources do
 * not know.
 */
#ifndef APC_SHM_MODEL_H
#define APC_SHM_MODEL_H

#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <unistd.h>

memory_order model_order(memory_order order, const char *file, int line);
uint64_t model_load(const volatile void *at, size_t size, memory_order order);
void model_store(volatile void *at, size_t size, uint64_t value, memory_order order);
uint64_t model_add(volatile void *at, size_t size, uint64_t more, memory_order order);
void model_fence(memory_order order);
long model_futex(const volatile void *at, int operation, uint32_t expected);
int model_lock(void);
int model_unlock(void);

#define MODEL_ORDER(order) model_order((order), __FILE__, __LINE__)
#undef atomic_load_explicit
#define atomic_load_explicit(at, order)                                                                      \
    ((__typeof__((void)0, *(at)))model_load((at), sizeof *(at), MODEL_ORDER(order)))
#undef atomic_store_explicit
#define atomic_store_explicit(at, value, order)                                                              \
    model_store((at), sizeof *(at), (uint64_t)(value), MODEL_ORDER(order))
#undef atomic_fetch_add_explicit
#define atomic_fetch_add_explicit(at, more, order)                                                           \
    ((__typeof__((void)0, *(at)))model_add((at), sizeof *(at), (more), MODEL_ORDER(order)))
#undef atomic_thread_fence
#define atomic_thread_fence(order) model_fence(MODEL_ORDER(order))
#define syscall(number, at, operation, expected, timeout, ...)                                               \
    ((void)(timeout), model_futex((at), (operation), (uint32_t)(expected)))
#define pthread_mutex_trylock(mutex)                   ((void)(mutex), model_lock())
#define pthread_mutex_clocklock(mutex, clock, expires) ((void)(mutex), (void)(expires), model_lock())
#define pthread_mutex_consistent(mutex)                ((void)(mutex), 0)
#define pthread_mutex_unlock(mutex)                    ((void)(mutex), (void)model_unlock())

#endif
