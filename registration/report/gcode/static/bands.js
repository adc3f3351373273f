// Outlines of written lines: true width, round ends and corners (see bands.py beside this folder).
// All parts turn the same way round, so that a non-zero fill is their union.
const STRAIGHT = 1e-3;
const TURN = 2 * Math.PI;

// Adds one piece from (x0, y0) to (x1, y1), pixels; before is the direction of the piece that it
// joins, or null where the line begins; ends tells whether the line ends with it.
export function addBand(path, x0, y0, x1, y1, half, before, ends) {
  const angle = Math.atan2(y1 - y0, x1 - x0);
  const [ax, ay] = [-Math.sin(angle) * half, Math.cos(angle) * half];
  path.moveTo(x0 - ax, y0 - ay);
  path.lineTo(x1 - ax, y1 - ay);
  path.lineTo(x1 + ax, y1 + ay);
  path.lineTo(x0 + ax, y0 + ay);
  path.closePath();
  if (before === null) sector(path, x0, y0, half, angle + Math.PI / 2, Math.PI);
  else corner(path, x0, y0, half, before, angle);
  if (ends) sector(path, x1, y1, half, angle - Math.PI / 2, Math.PI);
  return angle;
}

function corner(path, x, y, half, before, after) {
  const turn = ((((after - before + Math.PI) % TURN) + TURN) % TURN) - Math.PI;
  if (Math.abs(turn) < STRAIGHT) return;
  const begin = turn > 0 ? before - Math.PI / 2 : after + Math.PI / 2;
  sector(path, x, y, half, begin, Math.abs(turn));
}

function sector(path, x, y, half, begin, span) {
  path.moveTo(x, y);
  path.arc(x, y, half, begin, begin + span);
  path.closePath();
}
