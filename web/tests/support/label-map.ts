/** A mask with many structures, as a NIfTI-1 file. */

const HEADER = 352;
/** Room for one structure, voxels of 1 mm, and its half axes in it. */
const CELL = [18, 16, 9] as const;
const HALF = [8, 7, 3] as const;

/** `across` × `down` flat ellipsoids, labelled from 1 on. */
export function ellipsoids(across: number, down: number): Uint8Array {
  const dims = [across * CELL[0], down * CELL[1], CELL[2]] as const;
  const file = new Uint8Array(HEADER + dims[0] * dims[1] * dims[2]);
  writeHeader(new DataView(file.buffer), dims);
  let at = HEADER;
  for (let z = 0; z < dims[2]; z++) {
    for (let y = 0; y < dims[1]; y++) {
      for (let x = 0; x < dims[0]; x++, at++) {
        const within = [x, y, z].map(
          (voxel, axis) => ((voxel % (CELL[axis] ?? 1)) - (CELL[axis] ?? 1) / 2) / (HALF[axis] ?? 1),
        );
        const isInside = Math.hypot(...within) <= 1;
        if (isInside) file[at] = 1 + Math.floor(x / CELL[0]) + across * Math.floor(y / CELL[1]);
      }
    }
  }
  return file;
}

/** As the standard lays it down: bytes, 1 mm, an sform that is the identity. */
function writeHeader(view: DataView, dims: readonly number[]): void {
  view.setInt32(0, 348, true);
  for (const [axis, size] of [3, ...dims, 1, 1, 1, 1].entries()) view.setInt16(40 + 2 * axis, size, true);
  view.setInt16(70, 2, true);
  view.setInt16(72, 8, true);
  for (let axis = 0; axis < 8; axis++) view.setFloat32(76 + 4 * axis, 1, true);
  view.setFloat32(108, HEADER, true);
  view.setUint8(123, 2);
  view.setInt16(254, 1, true);
  for (let row = 0; row < 3; row++) view.setFloat32(280 + 20 * row, 1, true);
  for (const [at, byte] of [0x6e, 0x2b, 0x31, 0].entries()) view.setUint8(344 + at, byte);
}
