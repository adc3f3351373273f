// The move nearest to the pointer: a written line under it, else a way or a dot beside it.
import { ACT } from "gcode/moves";

const REACH_PX = 7;

export function nearest(parts, camera, u, v, shown) {
  let [best, found] = [REACH_PX, null];
  for (const { chunk, first, last } of parts) {
    for (let i = Math.max(first, 1); i < last; i++) {
      const act = chunk.act[i];
      if (act === ACT.JUMP || !shown(act)) continue;
      const away = distance(chunk, i, camera, u, v)
        - (act === ACT.WRITE ? ((chunk.width[i] || 0) * camera.scale) / 2 : -1);
      // Of lines that lie over each other under the pointer the last written is meant.
      const value = act === ACT.PRIME || act === ACT.RETRACT ? away - 3 : Math.max(away, 0);
      if (value < best || (value === best && value < REACH_PX)) [best, found] = [value, { chunk, i }];
    }
  }
  return found;
}

function distance(chunk, i, camera, u, v) {
  const at = (k) => [camera.u(chunk.x[k], chunk.y[k], chunk.z[k]),
    camera.v(chunk.x[k], chunk.y[k], chunk.z[k])];
  const [[u0, v0], [u1, v1]] = [at(i - 1), at(i)];
  const [du, dv] = [u1 - u0, v1 - v0];
  const along = du * du + dv * dv;
  const t = along ? Math.min(Math.max(((u - u0) * du + (v - v0) * dv) / along, 0), 1) : 0;
  return Math.hypot(u - u0 - t * du, v - v0 - t * dv);
}
