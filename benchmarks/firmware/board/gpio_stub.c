/* GPIO lines for Klipper's Linux process, loaded before it (LD_PRELOAD): motors without a machine.
 *
 * /dev/gpiochip0 opens, lines may be requested, and each rising edge of a step line is written to the
 * log named by GPIO_STUB_LOG: a file mapped into memory, so that it survives kill -9. Records are
 * those of avr_board.h, their cycle is 0. Lines of axis i: step 3i, direction 3i+1, enable 3i+2
 * (inverted), lower endstop 13+i, hit at 0 steps. GPIO_STUB_START: X,Y,Z steps at the beginning. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>
#include <linux/gpio.h>

#define AXES 4
#define LINES 64
#define RECORDS 4000000u

typedef struct log_record {
  uint64_t cycle, ns;
  int32_t position;
  uint8_t axis;
  int8_t direction;
  uint8_t enabled, kind;
} log_record;

static log_record *records;
static unsigned count;
static int levels[LINES], line_of_fd[1024];
static int32_t position[AXES], start[3];

static uint64_t host_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000000000ull + t.tv_nsec;
}

static void add(int kind, int axis, int direction, int enabled) {
  if (!records || count >= RECORDS) return;
  log_record r = {0, host_ns(), position[axis], axis, direction, enabled, kind};
  records[count++] = r;
}

/* After a restart of the firmware the process begins anew: go on behind the last record. */
static void go_on(void) {
  while (count < RECORDS && records[count].ns) {
    log_record *r = &records[count++];
    if (r->kind == 0) position[r->axis] = r->position;
  }
}

__attribute__((constructor)) static void begin(void) {
  const char *path = getenv("GPIO_STUB_LOG"), *from = getenv("GPIO_STUB_START");
  if (from) sscanf(from, "%d,%d,%d", &start[0], &start[1], &start[2]);
  int fd = path ? open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0644) : -1;
  if (fd < 0 || ftruncate(fd, sizeof *records * (size_t)RECORDS)) return;
  records = mmap(NULL, sizeof *records * (size_t)RECORDS, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  close(fd);
  if (records == MAP_FAILED) records = NULL;
  if (!records) return;
  go_on();
  add(count ? 1 : 3, 0, 0, 0);
}

static void set_line(int line, int level) {
  if (line < 0 || line >= LINES || levels[line] == level) return;
  levels[line] = level;
  int axis = line / 3;
  if (line == 12) add(6, 0, level, 0);
  if (axis >= AXES) return;
  if (line % 3 == 2) add(7, axis, !level, !level);
  if (line % 3 || !level) return;
  int enabled = !levels[3 * axis + 2], direction = levels[3 * axis + 1] ? 1 : -1;
  if (enabled) position[axis] += direction;
  add(0, axis, direction, enabled);
}

static int get_line(int line) {
  int axis = line - 13;
  return axis >= 0 && axis < 3 ? start[axis] + position[axis] <= 0 : levels[line & (LINES - 1)];
}

static int is_chip(const char *path) { return strcmp(path, "/dev/gpiochip0") == 0; }

int access(const char *path, int mode) {
  int (*real)(const char *, int) = dlsym(RTLD_NEXT, "access");
  return is_chip(path) ? 0 : real(path, mode);
}

int open(const char *path, int flags, ...) {
  int (*real)(const char *, int, ...) = dlsym(RTLD_NEXT, "open");
  va_list more;
  va_start(more, flags);
  int mode = flags & O_CREAT ? va_arg(more, int) : 0;
  va_end(more);
  return real(is_chip(path) ? "/dev/null" : path, flags, mode);
}

static int request(struct gpiohandle_request *asked) {
  int fd = open("/dev/null", O_RDWR | O_CLOEXEC), line = asked->lineoffsets[0];
  if (fd < 0 || fd >= 1024) return -1;
  line_of_fd[fd] = line + 1;
  asked->fd = fd;
  if (asked->flags & GPIOHANDLE_REQUEST_OUTPUT) set_line(line, asked->default_values[0]);
  return 0;
}

int ioctl(int fd, unsigned long what, ...) {
  static int (*real)(int, unsigned long, ...);
  va_list more;
  va_start(more, what);
  void *argument = va_arg(more, void *);
  va_end(more);
  if (what == GPIOHANDLE_SET_LINE_VALUES_IOCTL && fd >= 0 && fd < 1024 && line_of_fd[fd]) {
    set_line(line_of_fd[fd] - 1, ((struct gpiohandle_data *)argument)->values[0]);
    return 0;
  }
  if (what == GPIOHANDLE_GET_LINE_VALUES_IOCTL && fd >= 0 && fd < 1024 && line_of_fd[fd]) {
    ((struct gpiohandle_data *)argument)->values[0] = get_line(line_of_fd[fd] - 1);
    return 0;
  }
  if (what == GPIO_GET_LINEHANDLE_IOCTL) return request(argument);
  if (!real) real = dlsym(RTLD_NEXT, "ioctl");
  return real(fd, what, argument);
}
