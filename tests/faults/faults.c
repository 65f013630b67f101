/* Preloaded into a run: lets the n-th call of one kind fail, or sends a signal after so much processor time.
   FAULT=name:n:errno  (errno 0: half of the bytes are written; 28, no space, lasts from then on)   FAULT_SIGNAL=number:nanoseconds */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <time.h>

static char name[32] = "";
static long at, seen;
static int error;

__attribute__((constructor)) static void begin(void)
{
  const char *fault = getenv("FAULT"), *timed = getenv("FAULT_SIGNAL");
  int number;
  long after;
  if (fault) sscanf(fault, "%31[^:]:%ld:%d", name, &at, &error);
  if (timed && sscanf(timed, "%d:%ld", &number, &after) == 2) {
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = number};
    struct itimerspec when = {.it_value = {after / 1000000000, after % 1000000000}};
    timer_t timer;
    if (!timer_create(CLOCK_PROCESS_CPUTIME_ID, &event, &timer)) timer_settime(timer, 0, &when, NULL);
  }
}

static int fails(const char *call)
{
  if (strcmp(call, name)) return 0;
  seen++;
  return seen == at || (error == ENOSPC && seen > at);
}

#define WRAP(type, call, parameters, arguments)                          \
  type call parameters                                                   \
  {                                                                      \
    if (fails(#call)) { errno = error; return -1; }                      \
    return ((type(*) parameters)dlsym(RTLD_NEXT, #call)) arguments;      \
  }
WRAP(int, rename, (const char *from, const char *to), (from, to))
WRAP(int, fsync, (int fd), (fd))
WRAP(int, close, (int fd), (fd))
WRAP(int, mkdir, (const char *path, mode_t mode), (path, mode))
WRAP(int, unlink, (const char *path), (path))
WRAP(int, ftruncate, (int fd, off_t length), (fd, length))
WRAP(int, mkstemp, (char *path), (path))
WRAP(int, flock, (int fd, int operation), (fd, operation))
WRAP(off_t, lseek, (int fd, off_t offset, int whence), (fd, offset, whence))
WRAP(ssize_t, read, (int fd, void *bytes, size_t count), (fd, bytes, count))

ssize_t write(int fd, const void *bytes, size_t count)
{
  if (fd > 2 && fails("write")) {
    if (error) { errno = error; return -1; }
    count = (count + 1) / 2;
  }
  return ((ssize_t(*)(int, const void *, size_t))dlsym(RTLD_NEXT, "write"))(fd, bytes, count);
}
