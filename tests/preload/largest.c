/* A library to be preloaded (LD_PRELOAD): memory that ends, whatever the machine and its libraries take for themselves. No array may
   have more than LARGEST bytes. */
#include <errno.h>
#include <stdlib.h>

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);

static int refused(size_t bytes)
{
  const char *most = getenv("LARGEST");
  if (!most || bytes <= strtoul(most, NULL, 10)) return 0;
  errno = ENOMEM;
  return 1;
}

void *malloc(size_t bytes) { return refused(bytes) ? NULL : __libc_malloc(bytes); }
void *calloc(size_t n, size_t bytes) { return refused(n * bytes) ? NULL : __libc_calloc(n, bytes); }
void *realloc(void *old, size_t bytes) { return refused(bytes) ? NULL : __libc_realloc(old, bytes); }
