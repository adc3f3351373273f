/* A RAMPS 1.4 board (ATmega2560 in simavr) with its serial line, motors, sensors and faults. */
#ifndef AVR_BOARD_H
#define AVR_BOARD_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include <simavr/sim_avr.h>
#include <simavr/avr_uart.h>

#define CPU_HZ 16000000.0
#define AXES 4

uint64_t host_ns(void);

/* ---- Log: one record of 24 bytes for each event, written to a file in the machine's byte order. */
enum { LOG_STEP, LOG_RESET, LOG_POWER_OFF, LOG_POWER_ON, LOG_MARK, LOG_STALL, LOG_HEATER, LOG_ENABLE };

typedef struct log_record {
  uint64_t cycle;   /* of the processor, since the program began */
  uint64_t ns;      /* CLOCK_MONOTONIC of the host when the edge was carried out */
  int32_t position; /* steps, after the edge; the value of a mark */
  uint8_t axis;     /* 0 X, 1 Y, 2 Z, 3 E; of a heater 0 hotend, 1 bed, 2 fan */
  int8_t direction; /* +1 or -1; 0 and 1 for levels */
  uint8_t enabled;  /* 1 when the driver was enabled: only then the motor moves */
  uint8_t kind;
} log_record;

/* ---- Motors, endstops, heaters. */
typedef struct axis {
  int level_dir, enabled;
  int32_t position;  /* steps that the motor made, since the program began */
  int32_t start;     /* where the carriage stood then, steps above its lower endstop */
  uint64_t edges, dead_edges; /* all; those while the driver was disabled */
  uint64_t last_cycle, last_ns;
  char endstop;      /* 'a' automatic, 'o' open, 'h' hit */
} axis;

/* ---- Serial line: what may happen to bytes between the board and the host. */
typedef struct wire_faults {
  double noise_in, noise_out, drop_in, drop_out, lost_ok;
  uint64_t state;
  uint64_t hold_until;
  int ok_delays, ok_next;
  uint32_t ok_delay_ms[256];
} wire_faults;

typedef struct serial_line {
  int master, watch, opens, own_opens;
  bool strict_baud;
  char slave[64];
  const char *link;
  uint8_t in[256];          /* read from the host, not yet on the wire */
  unsigned in_head, in_tail;
  uint8_t out[1 << 16];     /* said by the board, not yet given to the host */
  uint64_t out_due[1 << 16];
  unsigned out_head, out_tail;
  uint64_t last_due;
  int column, pending_o, losing;
  uint64_t line_due;
  unsigned host_baud;
  wire_faults faults;
  uint64_t bytes_in, bytes_out, corrupted, dropped, lost_oks, delayed_oks, unread;
} serial_line;

/* ---- UART0 as the data sheet has it: two bytes and a shift register in, one and one out. */
typedef struct uart {
  avr_uart_t *sim;
  uint8_t in[3];
  int in_count;
  bool out_full;
  uint8_t out_next, out_shift;
  bool shifting;
  uint64_t overruns;
  uint64_t answered;        /* cycle at which the last line's end had left; 0 once a byte came */
  uint64_t turned, turns;   /* cycles from there to the next byte's begin, and how often */
} uart;

typedef struct board {
  avr_t *avr;
  axis axes[AXES];
  serial_line line;
  uart uart;
  FILE *log;
  uint64_t heater_edges[3], heater_last_on_ns[3];
  int heater_level[3];
  /* pacing */
  double speed;             /* times real time; 0: as fast as it goes */
  uint64_t anchor_ns, anchor_cycle, stall_until, boot_until, slipped_ns, began_ns, busy_ns;
  bool powered, quit, reset_on_open;
  uint64_t resets;
  int control, client;
  const char *control_path;
  char command[4096];
  unsigned command_length;
} board;

void log_event(board *b, int kind, int axis, int direction, int32_t position);
void board_reset(board *b);
void board_anchor(board *b);

void motion_begin(board *b);
void motion_reset(board *b);
void motion_endstops(board *b);
void sensor_begin(board *b);
void sensor_celsius(board *b, int channel, double celsius);
void sensor_millivolt(board *b, int channel, int millivolt);

void uart_begin(board *b);
bool uart_alive(board *b);
void uart_reset(board *b);
double uart_baud(board *b);

bool line_open(board *b);
void line_cut(board *b);
void line_poll(board *b);
bool line_take(board *b, uint8_t *byte);
void line_say(board *b, uint8_t byte);

bool control_open(board *b);
void control_poll(board *b);

#endif
