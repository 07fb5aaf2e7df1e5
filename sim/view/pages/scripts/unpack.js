// Restores arrays that are stored as differences (sim/view/encoding.py).
const ARRAYS = { Int8Array, Uint8Array, Int16Array, Uint16Array, Int32Array, Uint32Array, Float32Array };

function unpack(value) {
  if (Array.isArray(value)) return value.map(unpack);
  if (!value || typeof value !== "object" || ArrayBuffer.isView(value)) return value;
  if (value.differences) return added(value);
  for (const key of Object.keys(value)) value[key] = unpack(value[key]);
  return value;
}

// The differences stand column by column, the lowest bytes of all of them first.
function added({ differences: bytes, array, count, width, step }) {
  const [planes, rows, values] = [bytes.length / count, count / width, new ARRAYS[array](count)];
  for (let column = 0; column < width; column++) {
    let sum = 0;
    for (let row = 0; row < rows; row++) {
      let code = 0;
      for (let plane = planes - 1; plane >= 0; plane--) code = 256 * code + bytes[plane * count + column * rows + row];
      sum += code % 2 ? -(code + 1) / 2 : code / 2;
      values[row * width + column] = sum * step;
    }
  }
  return values;
}
