/* UART0 of the ATmega2560, in place of simavr's: overruns as on the chip, bytes at the baud rate.
 *
 * Modelled: two bytes of buffer and the receive shift register, data overrun, one byte of transmit
 * buffer and the shift register, the flags RXC, UDRE, TXC, DOR and their interrupts.
 * Not modelled: parity, 9 bits, multi-processor mode, framing errors. */
#include "avr_board.h"

#define UDR 0xC6
#define UCSRA 0xC0
#define UCSRB 0xC1
#define UBRRL 0xC4
enum { MPCM = 0, U2X = 1, DOR = 3, UDRE = 5, TXC = 6, RXC = 7, UDRIE = 5, RXEN = 4, TXEN = 3 };

static void flag(board *b, int bit, bool on) {
  uint8_t *a = &b->avr->data[UCSRA];
  *a = on ? *a | (1 << bit) : *a & ~(1 << bit);
}

static bool enabled(board *b, int bit) { return b->avr->data[UCSRB] >> bit & 1; }

double uart_baud(board *b) {
  unsigned divisor = (b->avr->data[UBRRL] | (b->avr->data[UBRRL + 1] & 15) << 8) + 1;
  return CPU_HZ / ((b->avr->data[UCSRA] >> U2X & 1 ? 8 : 16) * (double)divisor);
}

static avr_cycle_count_t byte_cycles(board *b) { return 10 * CPU_HZ / uart_baud(b); }

/* The host's turnaround. */
static void note_turn(board *b, avr_cycle_count_t begun) {
  uart *u = &b->uart;
  if (u->answered && begun > u->answered) u->turned += begun - u->answered, u->turns++;
  u->answered = 0;
}

static avr_cycle_count_t byte_arrives(avr_t *avr, avr_cycle_count_t when, void *param) {
  board *b = param;
  uart *u = &b->uart;
  uint8_t byte;
  if (line_take(b, &byte) && enabled(b, RXEN)) {
    note_turn(b, avr->cycle - byte_cycles(b));
    if (u->in_count == 3) { /* the shift register is written over */
      u->in[2] = byte;
      u->overruns++;
      flag(b, DOR, true);
    } else
      u->in[u->in_count++] = byte;
    avr_raise_interrupt(avr, &u->sim->rxc);
  }
  return when + byte_cycles(b);
}

static uint8_t read_udr(avr_t *avr, avr_io_addr_t addr, void *param) {
  board *b = param;
  uart *u = &b->uart;
  uint8_t byte = u->in[0];
  u->in[0] = u->in[1];
  u->in[1] = u->in[2];
  if (u->in_count > 0) u->in_count--;
  flag(b, DOR, false);
  avr_clear_interrupt(avr, &u->sim->rxc);
  flag(b, RXC, false);
  if (u->in_count > 0) avr_raise_interrupt(avr, &u->sim->rxc);
  return byte;
}

static avr_cycle_count_t byte_left(avr_t *avr, avr_cycle_count_t when, void *param) {
  board *b = param;
  uart *u = &b->uart;
  line_say(b, u->out_shift);
  if (u->out_shift == '\n') u->answered = avr->cycle;
  u->shifting = u->out_full;
  if (!u->out_full) {
    avr_raise_interrupt(avr, &u->sim->txc);
    return 0;
  }
  u->out_shift = u->out_next;
  u->out_full = false;
  avr_raise_interrupt(avr, &u->sim->udrc);
  return when + byte_cycles(b);
}

static void write_udr(avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param) {
  board *b = param;
  uart *u = &b->uart;
  if (!enabled(b, TXEN)) return;
  if (!u->shifting) {
    u->out_shift = value;
    u->shifting = true;
    avr_cycle_timer_register(avr, byte_cycles(b), byte_left, b);
    if (enabled(b, UDRIE)) avr_raise_interrupt(avr, &u->sim->udrc);
  } else if (!u->out_full) {
    u->out_next = value;
    u->out_full = true;
    avr_clear_interrupt(avr, &u->sim->udrc);
    flag(b, UDRE, false);
  }
}

static uint8_t read_status(avr_t *avr, avr_io_addr_t addr, void *param) { return avr->data[addr]; }

static void write_status(avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param) {
  board *b = param;
  uint8_t own = 1 << U2X | 1 << MPCM;
  if (value >> TXC & 1) {
    avr_clear_interrupt(avr, &b->uart.sim->txc);
    flag(b, TXC, false);
  }
  avr->data[addr] = (avr->data[addr] & ~own) | (value & own);
}

static void write_enables(avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param) {
  board *b = param;
  avr->data[addr] = value;
  if (!(value >> RXEN & 1)) b->uart.in_count = 0;
  if (value >> UDRIE & 1 && avr->data[UCSRA] >> UDRE & 1)
    avr_raise_interrupt(avr, &b->uart.sim->udrc);
  if (b->uart.in_count > 0) avr_raise_interrupt(avr, &b->uart.sim->rxc);
}

static void hook(board *b, int addr, avr_io_read_t read, avr_io_write_t write) {
  avr_io_addr_t io = AVR_DATA_TO_IO(addr);
  if (read) b->avr->io[io].r.c = read, b->avr->io[io].r.param = b;
  if (write) b->avr->io[io].w.c = write, b->avr->io[io].w.param = b;
}

void uart_begin(board *b) {
  for (avr_io_t *io = b->avr->io_port; io; io = io->next)
    if (io->kind && io->irq_ioctl_get == AVR_IOCTL_UART_GETIRQ('0')) b->uart.sim = (avr_uart_t *)io;
  uint32_t flags = 0;
  avr_ioctl(b->avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  hook(b, UDR, read_udr, write_udr);
  hook(b, UCSRA, read_status, write_status);
  hook(b, UCSRB, NULL, write_enables);
  uart_reset(b);
}

void uart_reset(board *b) {
  b->uart.in_count = 0;
  b->uart.out_full = b->uart.shifting = false;
  b->avr->data[UCSRA] = 1 << UDRE;
  avr_cycle_timer_cancel(b->avr, byte_left, b);
  avr_cycle_timer_register(b->avr, byte_cycles(b), byte_arrives, b);
}

bool uart_alive(board *b) { return avr_cycle_timer_status(b->avr, byte_arrives, b) != 0; }
