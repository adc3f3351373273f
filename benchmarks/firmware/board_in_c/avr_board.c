/* Run an ATmega2560 firmware on a simulated RAMPS 1.4 with its serial port as a pseudo-terminal.
 *
 * avr_board FIRMWARE.elf --port LINK --control SOCKET --log FILE [--speed 1.0] [--strict-baud]
 *           [--reset-on-open] [--start X,Y,Z (mm above the lower endstops)]
 *
 * The processor is paced to real time times `speed`; 0 is unpaced. Where the host falls more than
 * 50 ms behind, the board's time slips, and the sum is reported. */
#define _GNU_SOURCE
#include <getopt.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <simavr/sim_elf.h>

#include "avr_board.h"

#define SLICE 8000 /* cycles between two looks at the line: 0.5 ms */
#define BEHIND (16000 * 50)

uint64_t host_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000000000ull + t.tv_nsec;
}

void log_event(board *b, int kind, int axis, int direction, int32_t position) {
  log_record r = {b->avr->cycle, host_ns(), position, axis, direction, 1, kind};
  if (b->log) fwrite(&r, sizeof r, 1, b->log);
}

void board_anchor(board *b) {
  b->anchor_ns = host_ns();
  b->anchor_cycle = b->avr->cycle;
}

void board_reset(board *b) {
  avr_reset(b->avr);
  uart_reset(b);
  motion_reset(b);
  b->resets++;
  for (int i = 0; i < AXES; i++) b->axes[i].enabled = 0; /* pulled up on the driver */
  log_event(b, LOG_RESET, 0, 0, 0);
  board_anchor(b);
}

static void quiet(avr_t *avr, const int level, const char *format, va_list arguments) {
  if (level == LOG_ERROR) vfprintf(stderr, format, arguments);
}

static bool load(board *b, const char *path, bool loud) {
  static elf_firmware_t firmware;
  avr_global_logger_set(quiet);
  if (elf_read_firmware(path, &firmware)) return false;
  b->avr = avr_make_mcu_by_name("atmega2560");
  if (!b->avr) return false;
  avr_init(b->avr);
  b->avr->log = LOG_ERROR;
  firmware.frequency = CPU_HZ;
  firmware.vcc = firmware.avcc = firmware.aref = 5000;
  avr_load_firmware(b->avr, &firmware);
  return true;
}

static uint64_t target_cycle(board *b, uint64_t now) {
  uint64_t cycle = b->avr->cycle;
  if (b->speed <= 0) return cycle + 4 * SLICE;
  uint64_t target = b->anchor_cycle + (now - b->anchor_ns) * (b->speed * CPU_HZ / 1e9);
  if (target > cycle + BEHIND) {
    b->slipped_ns += (target - cycle) / (b->speed * CPU_HZ) * 1e9;
    board_anchor(b);
    return cycle + SLICE;
  }
  return target;
}

static void run_slice(board *b, uint64_t target) {
  uint64_t begin = host_ns();
  if (target > b->avr->cycle + SLICE && b->speed > 0) target = b->avr->cycle + SLICE;
  while (b->avr->cycle < target && b->avr->state != cpu_Done && b->avr->state != cpu_Crashed)
    b->avr->run(b->avr);
  if (!uart_alive(b)) uart_reset(b), motion_reset(b), b->resets++; /* the watchdog's reset */
  b->busy_ns += host_ns() - begin;
}

static void nap(int us) { usleep(us); }

static void run(board *b) {
  while (!b->quit) {
    control_poll(b);
    line_poll(b);
    uint64_t now = host_ns();
    if (!b->powered || now < b->stall_until || now < b->boot_until) {
      if (now < b->boot_until || !b->powered) b->line.in_tail = b->line.in_head;
      nap(500);
      board_anchor(b);
      continue;
    }
    uint64_t target = target_cycle(b, now);
    if (target <= b->avr->cycle + 1000)
      nap(300);
    else
      run_slice(b, target);
  }
}

static void starts(board *b, const char *text) {
  double mm[3] = {100, 100, 50};
  static const double STEPS[3] = {80, 80, 400};
  if (text) sscanf(text, "%lf,%lf,%lf", &mm[0], &mm[1], &mm[2]);
  for (int i = 0; i < 3; i++) b->axes[i].start = mm[i] * STEPS[i];
}

static board the_board;

static void ended(int signal) { the_board.quit = true; }

static bool options(board *b, int count, char **words) {
  static const struct option names[] = {
      {"port", 1, 0, 'p'},  {"control", 1, 0, 'c'}, {"log", 1, 0, 'l'},       {"speed", 1, 0, 's'},
      {"start", 1, 0, 'x'}, {"strict-baud", 0, 0, 'b'}, {"reset-on-open", 0, 0, 'r'}, {0}};
  const char *log = NULL, *start = NULL;
  for (int c; (c = getopt_long(count, words, "", names, NULL)) != -1;) {
    if (c == 'p') b->line.link = optarg;
    else if (c == 'c') b->control_path = optarg;
    else if (c == 'l') log = optarg;
    else if (c == 's') b->speed = atof(optarg);
    else if (c == 'x') start = optarg;
    else if (c == 'b') b->line.strict_baud = true;
    else if (c == 'r') b->reset_on_open = true;
    else return false;
  }
  starts(b, start);
  b->log = log ? fopen(log, "wb") : NULL;
  return b->line.link && b->control_path && b->log && optind < count;
}

int main(int count, char **words) {
  board *b = &the_board;
  b->speed = 1.0;
  b->powered = true;
  b->line.faults.state = 88172645463325252ull;
  if (!options(b, count, words)) {
    fprintf(stderr, "use: avr_board FIRMWARE.elf --port LINK --control SOCKET --log FILE\n");
    return 2;
  }
  signal(SIGPIPE, SIG_IGN);
  signal(SIGTERM, ended);
  signal(SIGINT, ended);
  if (!load(b, words[optind], false) || !line_open(b) || !control_open(b)) {
    fprintf(stderr, "avr_board: can't start %s\n", words[optind]);
    return 1;
  }
  motion_begin(b);
  uart_begin(b);
  motion_reset(b);
  motion_endstops(b);
  sensor_begin(b);
  board_anchor(b);
  b->began_ns = host_ns();
  log_event(b, LOG_POWER_ON, 0, 0, 0);
  run(b);
  fclose(b->log);
  line_cut(b);
  unlink(b->control_path);
  return 0;
}
