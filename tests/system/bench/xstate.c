/* Loaded before libc into User-Mode Linux on hosts with AMX. Its kernel 6.1 hands ptrace a buffer for the extended
 * state that is too small there, and dies ("ptrace set fp regs failed, errno = 14"). Here the buffer grows to what
 * the host wants; the tile registers beyond it are left empty. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

enum { LARGEST = 65536, HEADER = 512 };
static const uint64_t TILES = (1ull << 17) | (1ull << 18);
static long (*real)(enum __ptrace_request, ...);

static long whole_state(int pid, char *state, size_t *length)
{
    struct iovec all = { state, LARGEST };
    long result = real(PTRACE_GETREGSET, pid, (void *)(long)NT_X86_XSTATE, &all);
    *length = all.iov_len;
    return result;
}

long ptrace(enum __ptrace_request request, ...)
{
    static char state[LARGEST];
    va_list arguments;
    va_start(arguments, request);
    int pid = (int)va_arg(arguments, long);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);
    if (!real)
        real = (long (*)(enum __ptrace_request, ...))dlsym(RTLD_NEXT, "ptrace");
    if ((request != PTRACE_GETREGSET && request != PTRACE_SETREGSET) || (long)address != NT_X86_XSTATE)
        return real(request, pid, address, data);
    struct iovec *asked = data;
    size_t length;
    long result = whole_state(pid, state, &length);
    if (result < 0)
        return result;
    size_t part = asked->iov_len < length ? asked->iov_len : length;
    if (request == PTRACE_GETREGSET) {
        memcpy(asked->iov_base, state, part);
        asked->iov_len = part;
        return 0;
    }
    memcpy(state, asked->iov_base, part);
    uint64_t present;
    memcpy(&present, state + HEADER, sizeof present);
    present &= ~TILES;
    memcpy(state + HEADER, &present, sizeof present);
    struct iovec all = { state, length };
    return real(PTRACE_SETREGSET, pid, address, &all);
}
