/* Commands over a UNIX socket: a line each way, the answer one JSON object. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "avr_board.h"

bool control_open(board *b) {
  struct sockaddr_un name = {.sun_family = AF_UNIX};
  strncpy(name.sun_path, b->control_path, sizeof name.sun_path - 1);
  unlink(b->control_path);
  b->client = -1;
  b->control = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  return bind(b->control, (struct sockaddr *)&name, sizeof name) == 0 && listen(b->control, 4) == 0;
}

static int list_axes(board *b, char *to, int room) {
  static const char NAMES[] = "XYZE";
  int n = 0;
  for (int i = 0; i < AXES; i++) {
    axis *a = &b->axes[i];
    n += snprintf(to + n, room - n,
                  "%s\"%c\":{\"position\":%d,\"edges\":%lu,\"dead_edges\":%lu,\"enabled\":%d,"
                  "\"last_ns\":%lu,\"last_cycle\":%lu}",
                  i ? "," : "", NAMES[i], a->position, a->edges, a->dead_edges, a->enabled,
                  a->last_ns, a->last_cycle);
  }
  return n;
}

static uint64_t last_edge(board *b) {
  uint64_t last = 0;
  for (int i = 0; i < AXES; i++)
    if (b->axes[i].last_ns > last) last = b->axes[i].last_ns;
  return last;
}

static void report(board *b, char *to, int room) {
  serial_line *l = &b->line;
  uint64_t now = host_ns();
  int n = snprintf(to, room, "{\"ok\":true,\"ns\":%lu,\"cycle\":%lu,\"last_ns\":%lu,\"axes\":{", now,
                   (unsigned long)b->avr->cycle, last_edge(b));
  n += list_axes(b, to + n, room - n);
  snprintf(to + n, room - n,
           "},\"powered\":%d,\"speed\":%g,\"slipped_s\":%.3f,\"wall_s\":%.3f,\"busy_s\":%.3f,"
           "\"resets\":%lu,\"baud\":%.0f,\"host_baud\":%u,\"opens\":%d,\"overruns\":%lu,"
           "\"bytes_in\":%lu,\"bytes_out\":%lu,\"corrupted\":%lu,\"dropped\":%lu,\"lost_oks\":%lu,"
           "\"delayed_oks\":%lu,\"unread\":%lu,\"turned_s\":%.6f,\"turns\":%lu,\"cpu_state\":%d,"
           "\"heaters\":{\"hotend\":%d,\"bed\":%d,\"fan\":%d}}",
           b->powered, b->speed, b->slipped_ns / 1e9, (now - b->began_ns) / 1e9, b->busy_ns / 1e9,
           b->resets, uart_baud(b), l->host_baud, l->opens, b->uart.overruns, l->bytes_in,
           l->bytes_out, l->corrupted, l->dropped, l->lost_oks, l->delayed_oks, l->unread,
           b->uart.turned / (double)CPU_HZ, b->uart.turns,
           b->avr->state, b->heater_level[0], b->heater_level[1], b->heater_level[2]);
}

static void seed(board *b, const char *text) {
  if (text) b->line.faults.state = 88172645463325252ull ^ (strtoull(text, NULL, 10) * 2654435761ull);
}

static bool fault(board *b, char **w) {
  wire_faults *f = &b->line.faults;
  if (!strcmp(w[0], "hold") && w[1])
    f->hold_until = host_ns() + (uint64_t)(atof(w[1]) * 1e6);
  else if (!strcmp(w[0], "okdelay")) {
    f->ok_delays = f->ok_next = 0;
    while (w[1 + f->ok_delays] && f->ok_delays < 256)
      f->ok_delay_ms[f->ok_delays] = atoi(w[1 + f->ok_delays]), f->ok_delays++;
  } else if (!strcmp(w[0], "lostok") && w[1])
    f->lost_ok = atof(w[1]), seed(b, w[2]);
  else if ((!strcmp(w[0], "noise") || !strcmp(w[0], "drop")) && w[1] && w[2]) {
    double rate = atof(w[2]);
    bool noise = w[0][0] == 'n', in = w[1][0] != 'o', out = w[1][0] != 'i';
    if (in) *(noise ? &f->noise_in : &f->drop_in) = rate;
    if (out) *(noise ? &f->noise_out : &f->drop_out) = rate;
    seed(b, w[3]);
  } else if (!strcmp(w[0], "clear")) {
    uint64_t state = f->state;
    memset(f, 0, sizeof *f);
    f->state = state;
  } else if (!strcmp(w[0], "cut"))
    line_cut(b);
  else if (!strcmp(w[0], "plug"))
    return b->line.master >= 0 || line_open(b);
  else
    return false;
  return true;
}

static bool power(board *b, char **w) {
  if (!strcmp(w[0], "speed") && w[1])
    b->speed = atof(w[1]);
  else if (!strcmp(w[0], "stall") && w[1]) {
    b->stall_until = host_ns() + (uint64_t)(atof(w[1]) * 1e9);
    log_event(b, LOG_STALL, 0, 0, atof(w[1]) * 1000);
  } else if (!strcmp(w[0], "reset"))
    board_reset(b);
  else if (!strcmp(w[0], "poweroff")) {
    b->powered = false;
    log_event(b, LOG_POWER_OFF, 0, 0, 0);
  } else if (!strcmp(w[0], "poweron")) {
    if (!b->powered) board_reset(b);
    b->powered = true;
    log_event(b, LOG_POWER_ON, 0, 0, 0);
  } else if (!strcmp(w[0], "quit"))
    b->quit = true;
  else
    return false;
  board_anchor(b);
  return true;
}

static bool sensor(board *b, char **w) {
  const char *letters = "XYZE", *found;
  if (!strcmp(w[0], "temp") && w[1] && w[2])
    sensor_celsius(b, w[1][0] == 'b' ? 14 : 13, atof(w[2]));
  else if (!strcmp(w[0], "adc") && w[1] && w[2])
    sensor_millivolt(b, atoi(w[1]), atoi(w[2]));
  else if (!strcmp(w[0], "endstop") && w[1] && w[2] && (found = strchr(letters, w[1][0]))) {
    b->axes[found - letters].endstop = w[2][0];
    motion_endstops(b);
  } else if (!strcmp(w[0], "mark") && w[1])
    log_event(b, LOG_MARK, 0, 0, atoi(w[1]));
  else if (!strcmp(w[0], "flush"))
    fflush(b->log);
  else
    return !strcmp(w[0], "stat");
  return true;
}

static void answer(board *b, char *line) {
  static char reply[8192];
  char *words[300] = {0}, *save;
  int n = 0;
  for (char *w = strtok_r(line, " \r", &save); w && n < 290; w = strtok_r(NULL, " \r", &save))
    words[n++] = w;
  if (n && (fault(b, words) || power(b, words) || sensor(b, words)))
    report(b, reply, sizeof reply - 2);
  else
    strcpy(reply, "{\"ok\":false,\"error\":\"unknown command or missing argument\"}");
  strcat(reply, "\n");
  if (write(b->client, reply, strlen(reply)) < 0) return;
}

void control_poll(board *b) {
  if (b->client < 0) {
    b->client = accept4(b->control, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    b->command_length = 0;
    if (b->client < 0) return;
  }
  ssize_t n = read(b->client, b->command + b->command_length,
                   sizeof b->command - 1 - b->command_length);
  if (n == 0) {
    close(b->client);
    b->client = -1;
  }
  if (n <= 0) return;
  b->command_length += n;
  b->command[b->command_length] = 0;
  char *start = b->command, *end;
  while ((end = strchr(start, '\n'))) {
    *end = 0;
    answer(b, start);
    start = end + 1;
  }
  b->command_length = strlen(start);
  memmove(b->command, start, b->command_length + 1);
}
