// Draws rows of a piece: written lines to scale, ways between, dots where the plunger moves alone.
import { addBand } from "gcode/bands";
import { ACT } from "gcode/moves";

const THIN_PX = 1.4;
const HAIR_PX = 1.2;
const LINE_ALPHA = 0.78;
// Left free at each side of a line that is wide enough, so that neighbours can be told apart.
const SEAM_FROM_PX = 8;
const SEAM_PX = 0.3;

export class Painter {
  constructor(context, camera, theme) {
    Object.assign(this, { context, camera, theme });
  }

  // Rows first to last - 1 of a piece in screen coordinates; the row before the first is its start.
  places(chunk, first, last) {
    const from = Math.max(first - 1, 0);
    const u = new Float32Array(last - from);
    const v = new Float32Array(last - from);
    for (let i = from; i < last; i++) {
      u[i - from] = this.camera.u(chunk.x[i], chunk.y[i], chunk.z[i]);
      v[i - from] = this.camera.v(chunk.x[i], chunk.y[i], chunk.z[i]);
    }
    return { u, v, from };
  }

  outside(u0, v0, u1, v1, margin) {
    const [w, h] = this.camera.size;
    return Math.max(u0, u1) < -margin || Math.min(u0, u1) > w + margin
      || Math.max(v0, v1) < -margin || Math.min(v0, v1) > h + margin;
  }

  // Written lines as unions of one colour each; where lines overlap their colours do, too.
  bands(chunk, first, last, colours, ends) {
    const { u, v, from } = this.places(chunk, first, last);
    const { context, camera } = this;
    context.globalAlpha = LINE_ALPHA;
    let [path, bin, before, thin] = [null, -1, null, false];
    const flush = () => {
      if (!path) return;
      if (thin) {
        context.strokeStyle = colours.table[bin];
        context.stroke(path);
      } else {
        context.fillStyle = colours.table[bin];
        context.fill(path, "nonzero");
      }
      path = null;
    };
    context.lineCap = context.lineJoin = "round";
    for (let i = Math.max(first, 1); i < last; i++) {
      if (chunk.act[i] !== ACT.WRITE) { flush(); before = null; continue; }
      const [u0, v0, u1, v1] = [u[i - 1 - from], v[i - 1 - from], u[i - from], v[i - from]];
      const wide = (chunk.width[i] || 0) * camera.scale;
      if (this.outside(u0, v0, u1, v1, wide)) { flush(); before = null; continue; }
      const now = colours.bin(chunk, i, ...ends);
      const hair = wide < THIN_PX;
      if (!path || now !== bin || hair !== thin || hair) {
        flush();
        [path, bin, thin] = [new Path2D(), now, hair];
        if (hair) context.lineWidth = Math.max(wide, Number.isNaN(chunk.width[i]) ? HAIR_PX : 0.3);
      }
      if (hair) {
        path.moveTo(u0, v0);
        path.lineTo(u1, v1);
        before = Math.atan2(v1 - v0, u1 - u0);
      } else {
        const goesOn = i + 1 < last && chunk.act[i + 1] === ACT.WRITE;
        before = addBand(path, u0, v0, u1, v1, wide / 2 - (wide > SEAM_FROM_PX ? SEAM_PX : 0), before, !goesOn);
      }
    }
    flush();
    context.globalAlpha = 1;
  }

  // Written lines in space: round, the nearer ones over the farther ones, each with a dark rim.
  tubes(parts, colours) {
    const { context, camera } = this;
    const pieces = [];
    for (const { chunk, first, last } of parts) {
      const { u, v, from } = this.places(chunk, first, last);
      for (let i = Math.max(first, 1); i < last; i++) {
        if (chunk.act[i] !== ACT.WRITE) continue;
        const at = [u[i - 1 - from], v[i - 1 - from], u[i - from], v[i - from]];
        const wide = Math.max((chunk.width[i] || 0) * camera.scale, HAIR_PX);
        if (this.outside(...at, wide)) continue;
        const depth = camera.depth((chunk.x[i] + chunk.x[i - 1]) / 2,
          (chunk.y[i] + chunk.y[i - 1]) / 2, (chunk.z[i] + chunk.z[i - 1]) / 2);
        pieces.push([depth, ...at, wide, colours.bin(chunk, i, first, last)]);
      }
    }
    pieces.sort((a, b) => a[0] - b[0]);
    for (const [, u0, v0, u1, v1, wide, bin] of pieces) {
      context.beginPath();
      context.moveTo(u0, v0);
      context.lineTo(u1, v1);
      if (wide > 2.5) {
        // Along the sides only: round it would draw a ring at each joint.
        Object.assign(context, { strokeStyle: this.theme.rim, lineWidth: wide, lineCap: "butt" });
        context.stroke();
      }
      Object.assign(context, { strokeStyle: colours.table[bin], lineCap: "round" });
      context.lineWidth = wide > 2.5 ? wide - Math.min(1.6, 0.3 * wide) : wide;
      context.stroke();
    }
  }

  // Written lines as a faint ground, or the needle's path as a hairline.
  hairs(chunk, first, last, colour, width, alpha, acts = [ACT.WRITE], dashes = []) {
    const { u, v, from } = this.places(chunk, first, last);
    const { context } = this;
    Object.assign(context, { globalAlpha: alpha, strokeStyle: colour });
    context.setLineDash(dashes);
    context.beginPath();
    let [at, wide] = [-2, -1];
    for (let i = Math.max(first, 1); i < last; i++) {
      if (!acts.includes(chunk.act[i])) continue;
      const [a, b] = [i - 1 - from, i - from];
      if (this.outside(u[a], v[a], u[b], v[b], 0)) continue;
      const now = width ?? Math.max((chunk.width[i] || 0) * this.camera.scale, HAIR_PX);
      if (now !== wide) {
        context.stroke();
        context.beginPath();
        context.lineWidth = wide = now;
        at = -2;
      }
      if (at !== i - 1) context.moveTo(u[a], v[a]);
      context.lineTo(u[b], v[b]);
      at = i;
    }
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  travels(chunk, first, last) {
    this.hairs(chunk, first, last, this.theme.way, 1, 0.9, [ACT.TRAVEL]);
    this.hairs(chunk, first, last, this.theme.lifted, 1, 0.9, [ACT.LIFTED, ACT.WIPE], [5, 4]);
  }

  dots(chunk, first, last) {
    const { context, camera, theme } = this;
    for (let i = first; i < last; i++) {
      const act = chunk.act[i];
      if (act !== ACT.PRIME && act !== ACT.RETRACT) continue;
      const place = [chunk.x[i], chunk.y[i], chunk.z[i]];
      const [u, v] = [camera.u(...place), camera.v(...place)];
      // A prime is a full dot, a retraction a larger ring, since both often stand on one spot.
      context.beginPath();
      context.arc(u, v, act === ACT.PRIME ? 2.6 : 4.4, 0, 2 * Math.PI);
      context.lineWidth = 1.5;
      if (act === ACT.PRIME) {
        context.fillStyle = theme.prime;
        context.fill();
      } else {
        context.strokeStyle = theme.retract;
        context.stroke();
      }
    }
  }

  needle(chunk, i) {
    const { context, camera, theme } = this;
    const place = [chunk.x[i], chunk.y[i], chunk.z[i]];
    const [u, v] = [camera.u(...place), camera.v(...place)];
    for (const [colour, width] of [[theme.paper, 5], [theme.ink, 2]]) {
      Object.assign(context, { strokeStyle: colour, lineWidth: width });
      context.beginPath();
      context.arc(u, v, 8, 0, 2 * Math.PI);
      for (const [a, b] of [[-13, 0], [13, 0], [0, -13], [0, 13]]) {
        context.moveTo(u + 0.45 * a, v + 0.45 * b);
        context.lineTo(u + a, v + b);
      }
      context.stroke();
    }
  }

  mark(chunk, i) {
    const { context, camera, theme } = this;
    const path = new Path2D();
    const at = (k) => [camera.u(chunk.x[k], chunk.y[k], chunk.z[k]),
      camera.v(chunk.x[k], chunk.y[k], chunk.z[k])];
    const wide = Math.max((chunk.width[i] || 0) * camera.scale, 3);
    addBand(path, ...at(i - 1), ...at(i), wide / 2, null, true);
    context.fillStyle = theme.mark;
    context.fill(path, "nonzero");
  }
}
