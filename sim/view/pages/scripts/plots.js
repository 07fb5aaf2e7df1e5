// Curves over time on a canvas, with a cursor above it that costs no drawing.
const PLOT_LEFT = 3.1; // in the root's font size, as in panel.css
const PLOT_RIGHT = 0.6;
const DASHES = [[], [7, 3], [2, 2.5], [10, 3, 2, 3], [4, 4], [14, 4], [1.5, 4]];
const CLICK_AFTER_MS = 350; // so late may a click follow the end of a press, if any does
const STEPS_S = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600];

// A plot in a figure; what it shows comes with draw().
function createPlot(figure, seek) {
  const canvas = figure.querySelector("canvas");
  const cursor = figure.querySelector("i");
  const range = { from: 0, to: 1 };
  const timeAt = (event) => {
    const box = canvas.getBoundingClientRect();
    const [left, right] = [PLOT_LEFT * rem(), PLOT_RIGHT * rem()];
    const share = (event.clientX - box.left - left) / (box.width - left - right);
    return range.from + Math.min(Math.max(share, 0), 1) * (range.to - range.from);
  };
  // A finger may be about to scroll: it seeks by moving sideways, or by a tap.
  let pressed = null;
  const mayScroll = ({ pointerType, clientX, clientY }) => pointerType === "touch"
    && Math.abs(clientX - pressed.clientX) <= Math.abs(clientY - pressed.clientY);
  const seekUnder = (event) => { if (!mayScroll(event)) seek(timeAt(event)); };
  let releasing;
  const release = () => { clearTimeout(releasing); heldWindow = null; pointPanel(panelTime()); };
  canvas.addEventListener("pointerdown", (event) => {
    pressed = event;
    clearTimeout(releasing);
    heldWindow = { ...range };
    canvas.setPointerCapture(event.pointerId);
    seekUnder(event);
  });
  canvas.addEventListener("pointermove", (event) => { if (event.buttons & 1) seekUnder(event); });
  canvas.addEventListener("click", (event) => { seek(timeAt(event)); release(); });
  canvas.addEventListener("pointerup", () => { releasing = setTimeout(release, CLICK_AFTER_MS); });
  canvas.addEventListener("pointercancel", release);
  return {
    draw(picture) {
      Object.assign(range, { from: picture.from, to: picture.to });
      paint(canvas, picture);
    },
    point(time) {
      const share = (time - range.from) / (range.to - range.from || 1);
      cursor.hidden = !(share >= -1e-6 && share <= 1 + 1e-6);
      cursor.style.setProperty("--share", share);
    },
  };
}

// picture: from, to, low, high; rules: [{at, label, isLimit}]; curves: [{times, values, colour, dash, width}].
function paint(canvas, picture) {
  const { clientWidth: width, clientHeight: height } = canvas;
  if (!width || !height) return;
  const ratio = window.devicePixelRatio || 1;
  const unit = rem();
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.font = `${0.78 * unit}px system-ui, sans-serif`;
  const frame = { left: PLOT_LEFT * unit, right: width - PLOT_RIGHT * unit, top: 0.4 * unit, bottom: height - 1.25 * unit };
  const x = (time) => frame.left + ((time - picture.from) / (picture.to - picture.from || 1)) * (frame.right - frame.left);
  const y = (value) => frame.bottom - ((value - picture.low) / (picture.high - picture.low || 1)) * (frame.bottom - frame.top);
  paintAxes(pen, picture, frame, { x, y, unit });
  pen.save();
  pen.beginPath();
  pen.rect(frame.left, frame.top - 2, frame.right - frame.left, frame.bottom - frame.top + 4);
  pen.clip();
  for (const curve of picture.curves) paintCurve(pen, curve, picture, { x, y, unit });
  pen.restore();
}

function paintAxes(pen, { from, to, rules }, frame, { x, y, unit }) {
  pen.fillStyle = cssColour("--soft");
  pen.lineWidth = 1;
  const step = STEPS_S.find((s) => (to - from) / s <= 7) || 1200;
  pen.textAlign = "center";
  pen.textBaseline = "top";
  for (let k = Math.ceil(from / step - 1e-6); k * step <= to + 1e-9; k++) {
    pen.strokeStyle = cssColour("--grid");
    stroke(pen, [[x(k * step), frame.top], [x(k * step), frame.bottom]]);
    const last = (k + 1) * step > to + 1e-9;
    pen.fillText(`${Number((k * step).toFixed(1))}${last ? " s" : ""}`, Math.min(x(k * step), frame.right - 0.4 * unit), frame.bottom + 0.25 * unit);
  }
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (const { at, label, isLimit } of rules) {
    pen.strokeStyle = cssColour(isLimit ? "--limit" : "--grid");
    pen.setLineDash(isLimit ? [6, 4] : []);
    stroke(pen, [[frame.left, y(at)], [frame.right, y(at)]]);
    pen.fillText(label, frame.left - 0.35 * unit, y(at));
  }
  pen.setLineDash([]);
}

function paintCurve(pen, { times, values, colour, dash, width }, { from, to }, { x, y, unit }) {
  const first = Math.max(0, countUntil(times, from) - 1);
  const end = Math.min(times.length, countUntil(times, to) + 1);
  const points = [];
  for (let i = first; i < end; i++) points.push([x(times[i]), y(values(i))]);
  pen.strokeStyle = cssColour(colour);
  pen.lineWidth = (width * unit) / 15;
  pen.setLineDash(dash.map((length) => (length * unit) / 15));
  stroke(pen, points);
}

function stroke(pen, points) {
  pen.beginPath();
  for (const [px, py] of points) pen.lineTo(px, py);
  pen.stroke();
}
