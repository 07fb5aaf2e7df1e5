// The waypoints as a table, the one being moved to marked, and the stages as a list.
function listWaypoints() {
  const isReplay = document.body.dataset.mode === "replay";
  const sides = new Set(telemetry.waypoints.map((waypoint) => waypoint.side));
  element("waypoints").replaceChildren(...telemetry.waypoints.map((waypoint) => waypointRow(waypoint, sides.size > 1, isReplay)));
  element("waypoint-section").hidden = !telemetry.waypoints.length && element("stages").options.length < 2;
  element("waypoint-table").hidden = !telemetry.waypoints.length;
  panel.waypoints = null;
  showWaypoint(panelTime());
}

function waypointRow({ label, side, seed, end, position_error_m: off_m, orientation_error_rad: off_rad }, namesSide, isReplay) {
  const text = (namesSide ? `${side}, ${label}` : label) || "move";
  const head = make("th", {}, isReplay ? make("button", { type: "button", textContent: text }) : text);
  head.scope = "row";
  if (isReplay) head.firstChild.addEventListener("click", () => replay.jump(end === null ? replay.duration : end));
  const known = off_m !== null && off_m !== undefined;
  return make("tr", {}, head, make("td", { textContent: seed || "–" }), make("td", { textContent: known ? `${residual(off_m, "m")}, ${residual(off_rad, "rad")}` : "–" }));
}

function showWaypoint(time) {
  const now = waypointsAt(time);
  if (String(now) === String(panel.waypoints)) return;
  panel.waypoints = now;
  const rows = element("waypoints").rows;
  for (const row of rows) row.removeAttribute("aria-current");
  for (const row of now.map((index) => rows[index]).filter(Boolean)) {
    row.setAttribute("aria-current", "true");
    bringIntoSight(row, element("waypoint-table"));
  }
}

// Within its own table only; the panel does not scroll by itself.
function bringIntoSight(row, table) {
  if (table.matches(":hover, :focus-within")) return;
  const [inner, outer] = [row.getBoundingClientRect(), table.getBoundingClientRect()];
  const head = table.querySelector("thead").getBoundingClientRect().height;
  if (inner.top < outer.top + head) table.scrollTop += inner.top - outer.top - head;
  else if (inner.bottom > outer.bottom) table.scrollTop += inner.bottom - outer.bottom;
}

function listStages(captions) {
  element("stages").replaceChildren(...captions.map(([time, text]) => make("option", { value: time, textContent: `${time.toFixed(1)} s: ${text}` })));
  element("staged").hidden = captions.length < 2;
}
