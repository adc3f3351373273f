/* Preloaded into Klipper's Linux micro-controller: stands in for its GPIO chip and logs each write.
   Record: uint64 ns (CLOCK_REALTIME), uint32 pin, uint32 value; the first one counts the others. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <linux/gpio.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define MAX_RECORDS (1 << 22)
struct record { uint64_t ns; uint32_t pin, value; };
static struct record *records;
static int pin_of[1024], is_line[1024], chip = -1;

static void note(uint32_t pin, uint32_t value) {
    struct timespec now;
    if (!records) {
        int fd = open(getenv("GPIO_LOG"), O_RDWR | O_CREAT, 0600);
        size_t bytes = sizeof(struct record) * MAX_RECORDS;
        if (ftruncate(fd, bytes)) return;
        records = mmap(0, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
        close(fd);
    }
    clock_gettime(CLOCK_REALTIME, &now);
    struct record *next = records + 1 + records->ns;
    next->ns = now.tv_sec * 1000000000ull + now.tv_nsec;
    next->pin = pin, next->value = value;
    records->ns++;
}

int access(const char *path, int mode) {
    static int (*real)(const char *, int);
    if (!strncmp(path, "/dev/gpiochip", 13)) return 0;
    if (!real) real = dlsym(RTLD_NEXT, "access");
    return real(path, mode);
}

int open(const char *path, int flags, ...) {
    static int (*real)(const char *, int, ...);
    va_list more;
    va_start(more, flags);
    int mode = flags & O_CREAT ? va_arg(more, int) : 0;
    va_end(more);
    if (!real) real = dlsym(RTLD_NEXT, "open");
    if (strncmp(path, "/dev/gpiochip", 13)) return real(path, flags, mode);
    return chip = real("/dev/null", O_RDWR | O_CLOEXEC);
}

int ioctl(int fd, unsigned long request, ...) {
    static int (*real)(int, unsigned long, ...);
    va_list more;
    va_start(more, request);
    void *given = va_arg(more, void *);
    va_end(more);
    if (fd == chip && request == GPIO_GET_LINEHANDLE_IOCTL) {
        struct gpiohandle_request *wanted = given;
        wanted->fd = dup(fd);
        pin_of[wanted->fd] = wanted->lineoffsets[0], is_line[wanted->fd] = 1;
        return 0;
    }
    if (fd >= 0 && fd < 1024 && is_line[fd]) {
        struct gpiohandle_data *data = given;
        if (request == GPIOHANDLE_SET_LINE_VALUES_IOCTL) note(pin_of[fd], data->values[0]);
        else data->values[0] = 0;
        return 0;
    }
    if (!real) real = dlsym(RTLD_NEXT, "ioctl");
    return real(fd, request, given);
}
