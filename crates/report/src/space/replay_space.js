// The scene of a trial in space: solid, estimated surface, whisker, base, true and estimated contact with its ellipsoid, estimated contacts so far.
// Parallel projection; dragging a view, or the arrow keys, turn both views.
"use strict";
function stageOf(part, { draw, smooth }, redraw) {
  const perPixel = 0.01; // radians
  const perKey = 0.1; // radians
  const viewer = { azimuth: -2.2, elevation: 0.45 }; // direction from the scene to the viewer, radians

  // Unit vectors of the view in World: to the right and upwards.
  function sides() {
    const { azimuth, elevation } = viewer;
    return [
      [-Math.sin(azimuth), Math.cos(azimuth), 0],
      [-Math.sin(elevation) * Math.cos(azimuth), -Math.sin(elevation) * Math.sin(azimuth), Math.cos(elevation)],
    ];
  }

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  // The scene at a frame, in a view given by its centre in World and its width.
  function scene(view, { trial, run, frame }, centre, width) {
    const [right, up] = sides();
    const flat = spot => [dot(spot, right), -dot(spot, up)];
    const line = spots => "M" + spots.map(spot => flat(spot).map(Math.round).join(" ")).join("L");
    // Each spot as a line of no length, whose round ends are a dot of the same size at every zoom.
    const dots = spots => spots.filter(Boolean).map(spot => `M${flat(spot).map(Math.round).join(" ")}h0`).join("");
    const [x, y] = flat(centre);
    const height = width * 3 / 4;
    view.setAttribute("viewBox", `${x - width / 2} ${y - height / 2} ${width} ${height}`);
    view.replaceChildren();
    draw(view, "path", { class: "solid", d: trial.solid_um.map(line).join("") });
    for (const { colour, triangles } of run.surface) {
      const corners = triangles.map(triangle => triangle.map(index => run.vertices_um[index]));
      draw(view, "path", { class: "surface", fill: colour, stroke: colour, d: corners.map(line).join("") });
    }
    draw(view, "path", { class: "found", d: dots(run.contact_um.slice(0, frame + 1)) });
    if (trial.wire_um[frame]) draw(view, "path", { class: "wire", d: smooth(trial.wire_um[frame].map(flat)) });
    draw(view, "path", { class: "base", "stroke-linecap": "square", d: dots([trial.base_um[frame]]) });
    const [contact, truth, spread] = [run.contact_um[frame], trial.truth_um[frame], run.spread_um2[frame]];
    if (truth) {
      draw(view, "path", { class: "truth", d: dots([truth]) });
      draw(view, "path", { class: "core", d: dots([truth]) });
    }
    if (contact && spread) draw(view, "ellipse", { class: "ellipse", ...silhouette(spread, right, up, flat(contact)) });
    if (contact) draw(view, "path", { class: "estimate", d: dots([contact]) });
    compass(view, [x - 0.42 * width, y + 0.4 * height], width, right, up);
  }

  // Silhouette of the ellipsoid r' S^-1 r = 1 about a point, for S = [xx, xy, xz, yy, yz, zz].
  function silhouette([xx, xy, xz, yy, yz, zz], right, up, [x, y]) {
    const times = ([a, b, c]) => [xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c];
    const [a, b, c] = [dot(right, times(right)), -dot(right, times(up)), dot(up, times(up))];
    const mean = (a + c) / 2;
    const apart = Math.hypot((a - c) / 2, b);
    const degrees = Math.atan2(b, (a - c) / 2) * 90 / Math.PI;
    const [rx, ry] = [mean + apart, mean - apart].map(square => Math.sqrt(Math.max(square, 0)));
    return { rx, ry, transform: `translate(${x} ${y}) rotate(${degrees})` };
  }

  // The axes of World in a corner.
  function compass(view, [x, y], width, right, up) {
    for (const [index, name] of ["x", "y", "z"].entries()) {
      const end = [x + 0.05 * width * right[index], y - 0.05 * width * up[index]];
      draw(view, "path", { class: "axis", d: `M${x} ${y}L${end[0]} ${end[1]}` });
      const at = [x, y].map((from, k) => from + 1.4 * (end[k] - from));
      const style = `font-size: ${0.026 * width}px`;
      draw(view, "text", { x: at[0], y: at[1] + 0.008 * width, "text-anchor": "middle", style }, name);
    }
  }

  // Centre and width of a view that contains the path of the base and all shapes of the whisker from every side.
  function whole({ trial }) {
    const spots = [...trial.base_um, ...trial.wire_um.flat()].filter(Boolean);
    const bounds = [0, 1, 2].map(k => {
      const values = spots.map(spot => spot[k]);
      return [Math.min(...values), Math.max(...values)];
    });
    return [bounds.map(([low, high]) => (low + high) / 2), 1.4 * Math.hypot(...bounds.map(([low, high]) => high - low))];
  }

  function turn(azimuth, elevation) {
    viewer.azimuth += azimuth;
    viewer.elevation = Math.min(Math.max(viewer.elevation + elevation, -Math.PI / 2), Math.PI / 2);
    redraw();
  }

  for (const view of [part.overview, part.closeup]) {
    view.tabIndex = 0;
    view.classList.add("turned");
    view.addEventListener("pointerdown", event => view.setPointerCapture(event.pointerId));
    view.addEventListener("pointermove", event => {
      if (view.hasPointerCapture(event.pointerId)) turn(-perPixel * event.movementX, perPixel * event.movementY);
    });
    view.addEventListener("keydown", event => {
      const by = { ArrowLeft: [perKey, 0], ArrowRight: [-perKey, 0], ArrowUp: [0, perKey], ArrowDown: [0, -perKey] }[event.key];
      if (!by) return;
      event.preventDefault();
      turn(...by);
    });
  }
  return { scene, whole };
}
