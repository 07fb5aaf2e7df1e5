// All rotations at the chosen position: a row for each direction, a column for each roll.
const CHART_LABELS = 26; // more rows than this carry no names
const CHART_ROW = 1.15; // in the root's font size

const chart = { left: 0, width: 0, row: 0 };

function drawChart(choice) {
  const canvas = element("chart").querySelector("canvas");
  const unit = rem();
  const directions = atlas.map.directions;
  const isNamed = directions.length <= CHART_LABELS;
  chart.row = isNamed ? CHART_ROW * unit : Math.max((CHART_LABELS * CHART_ROW * unit) / directions.length, 3);
  chart.width = canvas.parentElement.clientWidth;
  if (!chart.width) return;
  chart.left = isNamed ? Math.min(9.6 * unit, 0.55 * chart.width) : 0;
  const ratio = window.devicePixelRatio || 1;
  const height = chart.row * directions.length;
  Object.assign(canvas, { width: Math.round(chart.width * ratio), height: Math.round(height * ratio) });
  canvas.style.height = `${height}px`;
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.font = `${0.82 * unit}px system-ui, sans-serif`;
  pen.textBaseline = "middle";
  pen.fillStyle = cssColour("--ink");
  if (isNamed) directions.forEach((name, d) => pen.fillText(name, 0, (d + 0.5) * chart.row, chart.left - 0.3 * unit));
  const place = placeOf(choice.cell);
  for (let r = 0; r < rotationCount(); r++) drawRotation(pen, r, levelAt(choice.arm, r, place), r === choice.rotation);
}

function boxOf(rotation) {
  const width = (chart.width - chart.left - 2) / rollCount();
  const [row, column] = [Math.floor(rotation / rollCount()), rotation % rollCount()];
  return [chart.left + column * width + 1, row * chart.row + 1, width - 2, chart.row - 2];
}

function drawRotation(pen, rotation, level, isShown) {
  const [x, y, width, height] = boxOf(rotation);
  const others = { [UNREACHABLE]: cssColour("--chip"), [UNDECIDED]: UNDECIDED_COLOUR, [NOT_COMPUTED]: UNKNOWN_COLOUR };
  pen.fillStyle = others[level] || `#${shadeOf(marginOf(level) / atlas.topMargin).getHexString()}`;
  pen.fillRect(x, y, width, height);
  if (!isShown) return;
  pen.strokeStyle = cssColour("--accent");
  pen.lineWidth = 3;
  pen.strokeRect(x, y, width, height);
}

function rotationUnder(event) {
  const box = element("chart").getBoundingClientRect();
  const column = Math.floor((event.clientX - box.left - chart.left) / ((chart.width - chart.left - 2) / rollCount()));
  const row = Math.floor((event.clientY - box.top) / chart.row);
  const isInside = column >= 0 && column < rollCount() && row >= 0 && row < atlas.map.directions.length;
  return isInside ? row * rollCount() + column : null;
}
