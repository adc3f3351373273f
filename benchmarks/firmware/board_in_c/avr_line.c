/* The serial line between board and host, a pseudo-terminal, with the faults that may be set.
 *
 * While no host has the port open, what the board says is lost, as with a USB adapter. */
#define _GNU_SOURCE
#include <asm/termbits.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "avr_board.h"

int grantpt(int), unlockpt(int), ptsname_r(int, char *, size_t);

static double chance(wire_faults *f) {
  f->state ^= f->state << 13, f->state ^= f->state >> 7, f->state ^= f->state << 17;
  return (f->state >> 11) / 9007199254740992.0;
}

static bool garble(board *b, uint8_t *byte, double noise, double drop) {
  serial_line *l = &b->line;
  if (noise > 0 && chance(&l->faults) < noise)
    *byte ^= 1 << (int)(8 * chance(&l->faults)), l->corrupted++;
  if (!(drop > 0 && chance(&l->faults) < drop)) return true;
  l->dropped++;
  return false;
}

static void set_raw(board *b) {
  int fd = open(b->line.slave, O_RDWR | O_NOCTTY | O_CLOEXEC);
  struct termios2 t;
  b->line.own_opens++;
  if (fd < 0 || ioctl(fd, TCGETS2, &t)) return;
  t.c_iflag = t.c_oflag = t.c_lflag = 0;
  t.c_cflag = (t.c_cflag & ~CSIZE) | CS8 | CREAD | CLOCAL;
  ioctl(fd, TCSETS2, &t);
  ioctl(fd, TCFLSH, TCIOFLUSH);
  close(fd);
}

bool line_open(board *b) {
  serial_line *l = &b->line;
  l->master = open("/dev/ptmx", O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (l->master < 0 || grantpt(l->master) || unlockpt(l->master)) return false;
  ptsname_r(l->master, l->slave, sizeof l->slave);
  l->watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
  inotify_add_watch(l->watch, l->slave, IN_OPEN | IN_CLOSE);
  l->opens = l->own_opens = 0;
  set_raw(b);
  unlink(l->link);
  return symlink(l->slave, l->link) == 0;
}

void line_cut(board *b) {
  serial_line *l = &b->line;
  if (l->master < 0) return;
  close(l->master), close(l->watch), unlink(l->link);
  l->master = l->watch = -1;
  l->in_head = l->in_tail = l->out_head = l->out_tail = 0;
}

static void count_hosts(board *b) {
  serial_line *l = &b->line;
  char buffer[4096] __attribute__((aligned(8)));
  ssize_t n = read(l->watch, buffer, sizeof buffer);
  for (char *at = buffer; n > 0 && at < buffer + n;) {
    struct inotify_event *e = (struct inotify_event *)at;
    at += sizeof *e + e->len;
    if (e->mask & IN_OPEN && l->own_opens) continue; /* set_raw's; its close comes next */
    if (e->mask & IN_CLOSE && l->own_opens) {
      l->own_opens--;
      continue;
    }
    l->opens += e->mask & IN_OPEN ? 1 : -1;
    if (e->mask & IN_OPEN && l->opens == 1 && b->reset_on_open) {
      board_reset(b);
      b->boot_until = host_ns() + 700000000ull; /* the boot loader's wait */
    }
    if (l->opens == 0) l->in_head = l->in_tail = 0;
  }
}

static void fill_from_host(board *b) {
  serial_line *l = &b->line;
  uint8_t bytes[64];
  unsigned room = 64 - (l->in_head - l->in_tail); /* a USB adapter's buffer */
  if (room > 64 || room == 0) return;
  ssize_t n = read(l->master, bytes, room);
  for (ssize_t i = 0; i < n; i++)
    if (garble(b, &bytes[i], l->faults.noise_in, l->faults.drop_in))
      l->in[l->in_head++ % sizeof l->in] = bytes[i];
  struct termios2 t;
  if (n > 0 && !ioctl(l->master, TCGETS2, &t)) l->host_baud = t.c_ospeed;
  if (n > 0) l->bytes_in += n;
}

static void give_to_host(board *b) {
  serial_line *l = &b->line;
  uint64_t now = host_ns();
  if (now < l->faults.hold_until) return;
  uint8_t bytes[256];
  unsigned n = 0, at = l->out_tail;
  while (n < sizeof bytes && at != l->out_head && l->out_due[at % sizeof l->out] <= now)
    bytes[n++] = l->out[at++ % sizeof l->out];
  if (n == 0) return;
  ssize_t given = l->opens > 0 ? write(l->master, bytes, n) : (ssize_t)n;
  if (l->opens <= 0) l->unread += n;
  if (given > 0) l->out_tail += given, l->bytes_out += given;
}

void line_poll(board *b) {
  if (b->line.master < 0) return;
  count_hosts(b);
  fill_from_host(b);
  give_to_host(b);
}

static bool wrong_baud(board *b) {
  unsigned host = b->line.host_baud;
  if (!b->line.strict_baud || host == 0) return false;
  double ratio = host / uart_baud(b);
  return ratio < 0.95 || ratio > 1.05;
}

bool line_take(board *b, uint8_t *byte) {
  serial_line *l = &b->line;
  if (l->in_head == l->in_tail) return false;
  *byte = l->in[l->in_tail++ % sizeof l->in];
  if (wrong_baud(b)) *byte = 256 * chance(&l->faults);
  return true;
}

static void queue(board *b, uint8_t byte) {
  serial_line *l = &b->line;
  uint64_t due = l->line_due > l->last_due ? l->line_due : l->last_due;
  if (wrong_baud(b)) byte = 256 * chance(&l->faults);
  if (!garble(b, &byte, l->faults.noise_out, l->faults.drop_out)) return;
  if (l->out_head - l->out_tail == sizeof l->out) return;
  l->out_due[l->out_head % sizeof l->out] = l->last_due = due;
  l->out[l->out_head++ % sizeof l->out] = byte;
}

static void begin_ok(board *b) {
  serial_line *l = &b->line;
  wire_faults *f = &l->faults;
  if (f->lost_ok > 0 && chance(f) < f->lost_ok) l->losing = 1, l->lost_oks++;
  if (!f->ok_delays) return;
  uint32_t ms = f->ok_delay_ms[f->ok_next++ % f->ok_delays];
  if (ms) l->line_due = host_ns() + ms * 1000000ull, l->delayed_oks++;
}

void line_say(board *b, uint8_t byte) {
  serial_line *l = &b->line;
  if (l->master < 0) return;
  if (l->column == 0 && byte == 'o') { /* the next byte tells whether it is an ok */
    l->pending_o = 1, l->column = 1;
    return;
  }
  if (l->pending_o) {
    l->pending_o = 0;
    if (byte == 'k') begin_ok(b);
    if (!l->losing) queue(b, 'o');
  }
  if (!l->losing) queue(b, byte);
  l->column++;
  if (byte == '\n') l->column = l->losing = 0, l->line_due = 0;
}
