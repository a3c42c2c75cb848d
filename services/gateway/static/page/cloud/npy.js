// Arrays in numpy's format: a header in words, then the numbers.

/** {shape, values} of a little-endian float32 array in C order; an Error for anything else. */
export function readNpy(buffer) {
  const bytes = new Uint8Array(buffer), view = new DataView(buffer);
  if (String.fromCharCode(...bytes.slice(1, 6)) !== "NUMPY") throw new Error("no array of numpy");
  const long = bytes[6] > 1, length = long ? view.getUint32(8, true) : view.getUint16(8, true), begin = (long ? 12 : 10) + length;
  const words = new TextDecoder("latin1").decode(bytes.slice(long ? 12 : 10, begin));
  const shape = /'shape': \(([^)]*)\)/.exec(words)?.[1].split(",").filter(s => s.trim()).map(Number);
  if (!shape || !words.includes("'<f4'") || words.includes("'fortran_order': True")) throw new Error(`an array of another kind: ${words}`);
  return { shape, values: new Float32Array(buffer, begin) };
}
