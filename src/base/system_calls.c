/* What Fortran lacks of the operating system: files that are replaced, locked and written whole; signals; child processes. Nothing
   is written through a symbolic link or into a pipe or device, and no file that exists is emptied. `posix.f90` says what each
   function does; texts come with their length. Where a call has failed the reason is in errno. */
#define _GNU_SOURCE
#include <ISO_Fortran_binding.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

typedef const CFI_cdesc_t *text;
enum { LONGEST = 4096, MOST_CHILDREN = 1024 };              /* of a path (PATH_MAX); as in posix.f90 */
static char locked[LONGEST];                                /* path of the lock that this process holds */
static volatile sig_atomic_t received, note_only, children[MOST_CHILDREN];
static bool ended;                                          /* the program ends by its own decision */
static pid_t parent;                                        /* of a child: the process that started it */

/* A path as C has it; one that is too long becomes empty, which no file is. */
static const char *c_path(text path, char *words)
{
  size_t n = path->elem_len < LONGEST ? path->elem_len : 0;
  memcpy(words, path->base_addr, n);
  words[n] = 0;
  return words;
}
#define PATH(path) c_path(path, (char[LONGEST]){0})

/* --- files */

void biela_make_folder(text path)
{
  char part[LONGEST];
  c_path(path, part);
  for (char *at = part + 1; *part && *at; at++)
    if (*at == '/') {
      *at = 0;
      mkdir(part, 0777);
      *at = '/';
    }
  mkdir(part, 0777);
}

/* Closes what is no ordinary file, or could not be locked; gives -1 with the reason. */
static int dropped(int handle)
{
  int why = errno;
  if (handle >= 0) close(handle);
  errno = why;
  return -1;
}

/* Opens an ordinary file; without O_CREAT one that exists. */
static int ordinary(const char *path, int flags)
{
  struct stat file;
  int handle = open(path, O_RDWR | O_NOFOLLOW | O_NONBLOCK | flags, 0666);
  return handle >= 0 && !fstat(handle, &file) && S_ISREG(file.st_mode) ? handle : dropped(handle);
}

int biela_extend_file(text path)
{
  return ordinary(PATH(path), 0);
}

void biela_remove_scratch(text path)
{
  int handle = biela_extend_file(path);
  if (handle < 0) return;
  unlink(PATH(path));
  close(handle);
}

/* Makes an empty file and opens it. An ordinary file of that name is replaced: its other names keep what it holds. The run-time
   library's own files do not report a full disk reliably: what they could not write is lost in silence. */
int biela_create_file(text path)
{
  biela_remove_scratch(path);
  return ordinary(PATH(path), O_CREAT | O_EXCL);
}

/* Removes a result, or the link that has its name; a pipe or a folder belongs to somebody else and stays. */
void biela_remove_file(text path)
{
  struct stat file;
  if (!lstat(PATH(path), &file) && !S_ISFIFO(file.st_mode) && !S_ISDIR(file.st_mode)) unlink(PATH(path));
}

/* Opens and locks a file for this process alone, until it ends. 0: another process holds it. Its holder removes the file: what was
   opened before that and locked after it has no name any more, and is no lock. */
int biela_lock_file(text path)
{
  struct stat file;
  for (;;) {
    int handle = ordinary(PATH(path), O_CREAT);
    if (handle < 0) return -1;
    if (flock(handle, LOCK_EX | LOCK_NB)) return dropped(handle) + 1;
    if (!fstat(handle, &file) && file.st_nlink > 0) {
      c_path(path, locked);
      return handle;
    }
    close(handle);
  }
}

/* Ends a lock, if the handle is one, and removes its file. */
void biela_close_lock(int handle)
{
  if (handle <= 0) return;
  unlink(locked);
  *locked = 0;
  close(handle);
}

bool biela_replace_file(text from, text to)
{
  return !rename(PATH(from), PATH(to));
}

/* Opens an ordinary file for reading that has no other name and is no link: what it holds would be lost with its name. -1: there is
   none; -2: it cannot be read. */
int biela_open_sole(text path)
{
  struct stat file;
  int handle;
  if (lstat(PATH(path), &file) || !S_ISREG(file.st_mode) || file.st_nlink > 1) return -1;
  handle = open(PATH(path), O_RDONLY | O_NOFOLLOW | O_NONBLOCK);
  return handle < 0 ? -2 : handle;
}

int biela_open_to_read(text path, int wait)
{
  return open(PATH(path), O_RDONLY | (wait ? 0 : O_NONBLOCK));
}

long biela_size_of(int handle)
{
  struct stat file;
  if (!fstat(handle, &file) && S_ISDIR(file.st_mode)) return -2;
  return fstat(handle, &file) || !S_ISREG(file.st_mode) || lseek(handle, 0, SEEK_SET) < 0 ? -1 : file.st_size;
}

long biela_file_size(text path)
{
  int handle = biela_open_to_read(path, 0);
  long bytes = handle < 0 ? -1 : biela_size_of(handle);
  dropped(handle);
  return bytes;
}

/* Whether two paths lead to one file. */
bool biela_same_file(text one, text other)
{
  struct stat a, b;
  return !stat(PATH(one), &a) && !stat(PATH(other), &b) && a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

int biela_nameless_file(void)
{
  char name[] = "/tmp/biela.XXXXXX";
  int handle = mkstemp(name);
  if (handle >= 0) unlink(name);
  return handle;
}

int biela_read_bytes(int handle, text bytes)
{
  ssize_t n;
  do n = read(handle, bytes->base_addr, bytes->elem_len); while (n < 0 && errno == EINTR);
  return (int)n;
}

/* Writes bytes; true where all of them are written. */
static bool written(int handle, const char *bytes, size_t count)
{
  while (count > 0) {
    ssize_t n = write(handle, bytes, count);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    bytes += n;
    count -= n;
  }
  return true;
}
bool biela_write_bytes(int handle, text bytes)
{
  return written(handle, bytes->base_addr, bytes->elem_len);
}

bool biela_cut_file(int handle, long length)
{
  return !ftruncate(handle, length) && lseek(handle, 0, SEEK_END) >= 0;
}

bool biela_close_file(int handle)
{
  return !close(handle);
}

bool biela_sync_file(int handle)
{
  return !fsync(handle);
}

bool biela_is_terminal(int handle)
{
  return isatty(handle);
}

/* Words of the system, behind them null characters: why the last call failed (0), name of this machine (1), current folder (2). */
void biela_words(int what, text words)
{
  char *to = words->base_addr;
  memset(to, 0, words->elem_len);
  if (what == 0) strncpy(to, strerror(errno), words->elem_len - 1);
  if (what == 1 && gethostname(to, words->elem_len - 1)) *to = 0;
  if (what == 2 && !getcwd(to, words->elem_len - 1)) *to = 0;
}

/* --- the process */

void biela_end_process(void)
{
  ended = true;
}

/* Called when the program ends. The run-time library ends it where memory cannot be had, with a line for programmers. */
static void say_why_ended(void)
{
  static const char why[] =
    "biela: stopped, most likely because the deck needs more memory than the system gives; rows on disk are complete\n";
  if (ended) return;
  if (*locked) unlink(locked);
  written(STDERR_FILENO, why, sizeof why - 1);
}

/* The handler of memory faults: compiled code does not ask everywhere whether it got the memory that it writes to. */
static void memory_fault(int number)
{
  (void)number;
  say_why_ended();
  _exit(1);                                                 /* status_failed */
}

/* The handler of signals: hands them on to children; ends the program, or notes them while results are written. */
static void note_signal(int number)
{
  received = number;
  for (int k = 0; k < MOST_CHILDREN; k++)
    if (children[k] > 0) kill(children[k], number);
  if (!note_only) _exit(128 + number);                      /* status_signal */
}

int biela_caught_signal(void)
{
  return received;
}

void biela_hold_signals(int yes)
{
  note_only = yes;
}

/* Prepares streams and handlers; called before anything else. A standard stream that is closed would give its number to the next
   file opened, a result perhaps: instead nothing can be read from it or written to it, and messages are lost. A write beyond a
   limit of file sizes, or to a pipe that nobody reads any more, fails like one on a full disk instead of ending the program. */
void biela_begin_process(void)
{
  for (int handle = 0; handle <= STDERR_FILENO; handle++)
    if (fcntl(handle, F_GETFD) < 0) open("/dev/null", handle == STDERR_FILENO ? O_WRONLY : O_RDONLY);
  atexit(say_why_ended);
  signal(SIGSEGV, memory_fault);
  signal(SIGINT, note_signal);
  signal(SIGTERM, note_signal);
  signal(SIGXFSZ, SIG_IGN);
  signal(SIGPIPE, SIG_IGN);
}

/* The handler of a child's alarm, once a second: a child whose parent has been killed ends as by a signal. */
static void look_for_parent(int number)
{
  (void)number;
  if (getppid() != parent) note_signal(SIGTERM);
  else alarm(1);
}

int biela_start_child(int output)
{
  pid_t starter = getpid(), child = fork();
  if (child == 0) {
    memset((void *)children, 0, sizeof children);
    note_only = false;
    parent = starter;
    signal(SIGALRM, look_for_parent);
    look_for_parent(SIGALRM);
    dup2(output, STDOUT_FILENO);
    dup2(output, STDERR_FILENO);
  } else if (child > 0) {
    int k = 0;
    while (children[k] > 0) k++;
    children[k] = child;
    if (received) kill(child, received);                    /* caught before the child stood in the list */
  }
  return child;
}

int biela_wait_for_child(int *status)
{
  int word = 0;
  pid_t child = waitpid(-1, &word, 0);
  *status = WIFSIGNALED(word) ? 128 + WTERMSIG(word) : WEXITSTATUS(word);
  for (int k = 0; k < MOST_CHILDREN; k++)
    if (children[k] == child) children[k] = 0;
  return child > 0 ? child : 0;
}
