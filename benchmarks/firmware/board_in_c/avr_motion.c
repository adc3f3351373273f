/* Motors, endstops, thermistors and heater outputs of a RAMPS 1.4.
 *
 * A step is a rising edge of a step pin. A motor whose driver is disabled does not move; the edge is
 * counted apart. Not modelled: torque, lost steps, microstep tables, times of set-up. */
#include <math.h>

#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>

#include "avr_board.h"

typedef struct pin { char port; int bit; } pin;
static const pin STEP[AXES] = {{'F', 0}, {'F', 6}, {'L', 3}, {'A', 4}};
static const pin DIR[AXES] = {{'F', 1}, {'F', 7}, {'L', 1}, {'A', 6}};
static const pin ENABLE[AXES] = {{'D', 7}, {'F', 2}, {'K', 0}, {'A', 2}};
static const pin ENDSTOP[3] = {{'E', 5}, {'J', 1}, {'D', 3}};
static const pin HEATER[3] = {{'B', 4}, {'H', 5}, {'H', 6}};
/* Level of the direction pin for a move away from the lower endstop (stock Marlin inverts Y). */
static const int AWAY[AXES] = {1, 0, 1, 1};

typedef struct hook { board *b; int axis; } hook;
static hook hooks[AXES], heaters[3];

static avr_irq_t *irq(board *b, pin p) {
  return avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ(p.port), p.bit);
}

static void stepped(struct avr_irq_t *source, uint32_t level, void *param) {
  hook *h = param;
  axis *a = &h->b->axes[h->axis];
  if (!level) return;
  int direction = a->level_dir == AWAY[h->axis] ? 1 : -1;
  a->edges++;
  if (a->enabled)
    a->position += direction;
  else
    a->dead_edges++;
  a->last_cycle = h->b->avr->cycle;
  a->last_ns = host_ns();
  log_record r = {a->last_cycle, a->last_ns, a->position, h->axis, direction, a->enabled, LOG_STEP};
  if (h->b->log) fwrite(&r, sizeof r, 1, h->b->log);
  if (h->axis < 3) motion_endstops(h->b);
}

static void turned(struct avr_irq_t *source, uint32_t level, void *param) {
  hook *h = param;
  h->b->axes[h->axis].level_dir = level;
}

static void powered(struct avr_irq_t *source, uint32_t level, void *param) {
  hook *h = param;
  h->b->axes[h->axis].enabled = !level;
  log_event(h->b, LOG_ENABLE, h->axis, !level, h->b->axes[h->axis].position);
}

static void heated(struct avr_irq_t *source, uint32_t level, void *param) {
  hook *h = param;
  h->b->heater_level[h->axis] = level;
  h->b->heater_edges[h->axis]++;
  h->b->heater_last_on_ns[h->axis] = host_ns();
  log_event(h->b, LOG_HEATER, h->axis, level, 0);
}

void motion_begin(board *b) {
  for (int i = 0; i < AXES; i++) {
    hooks[i] = (hook){b, i};
    b->axes[i].endstop = 'a';
    avr_irq_register_notify(irq(b, STEP[i]), stepped, &hooks[i]);
    avr_irq_register_notify(irq(b, DIR[i]), turned, &hooks[i]);
    avr_irq_register_notify(irq(b, ENABLE[i]), powered, &hooks[i]);
  }
  for (int i = 0; i < 3; i++) {
    heaters[i] = (hook){b, i};
    avr_irq_register_notify(irq(b, HEATER[i]), heated, &heaters[i]);
  }
}

void motion_endstops(board *b) {
  static int before[3] = {-1, -1, -1};
  static avr_ioport_external_t ports[3]; /* E, J, D: each port has one endstop here */
  for (int i = 0; i < 3; i++) {
    axis *a = &b->axes[i];
    int hit = a->endstop == 'h' || (a->endstop == 'a' && a->start + a->position <= 0);
    if (hit == before[i]) continue;
    before[i] = hit;
    ports[i].name = ENDSTOP[i].port;
    ports[i].mask = 1 << ENDSTOP[i].bit;
    ports[i].value = hit << ENDSTOP[i].bit;
    avr_ioctl(b->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(ENDSTOP[i].port), &ports[i]);
    avr_raise_irq(irq(b, ENDSTOP[i]), hit);
  }
}

/* simavr's ADC knows 8 channels; the thermistors are on 13 and 14. */
static int millivolts[16];

static uint8_t read_adc_low(avr_t *avr, avr_io_addr_t addr, void *param) {
  int channel = (avr->data[0x7C] & 7) | (avr->data[0x7B] >> 3 & 1) << 3;
  int value = millivolts[channel] * 1023 / 5000;
  avr->data[addr + 1] = value >> 8;
  return avr->data[addr] = value;
}

static uint8_t read_adc_high(avr_t *avr, avr_io_addr_t addr, void *param) {
  return avr->data[addr];
}

void sensor_begin(board *b) {
  b->avr->io[AVR_DATA_TO_IO(0x78)].r.c = read_adc_low;
  b->avr->io[AVR_DATA_TO_IO(0x79)].r.c = read_adc_high;
  for (int i = 0; i < 16; i++) sensor_millivolt(b, i, 5000);
  sensor_celsius(b, 13, 25);
  sensor_celsius(b, 14, 25);
}

/* A low endstop pin is also an interrupt input; simavr would look at it in every cycle. */
void motion_reset(board *b) {
  for (int i = 0; i < 8; i++) avr_extint_set_strict_lvl_trig(b->avr, i, 0);
}

void sensor_millivolt(board *b, int channel, int millivolt) { millivolts[channel & 15] = millivolt; }

void sensor_celsius(board *b, int channel, double celsius) {
  /* 100 kOhm NTC, B = 4092 K, with 4.7 kOhm to 5 V: within 1 K of Marlin's table 1 at 0 to 60 C. */
  double ohm = 1e5 * exp(4092.0 * (1 / (celsius + 273.15) - 1 / 298.15));
  sensor_millivolt(b, channel, 5000.0 * ohm / (ohm + 4700.0));
}
