// The scene of a trial in the plane: object, whisker, base, true and estimated contact with its ellipse, outline found so far.
"use strict";
function stageOf(part, { draw, smooth }) {
  const line = spots => "M" + spots.map(([x, y]) => `${x} ${-y}`).join("L");
  // Each spot as a line of no length, whose round ends are a dot of the same size at every zoom.
  const dots = spots => spots.filter(Boolean).map(([x, y]) => `M${x} ${-y}h0`).join("");

  // The scene at a frame, in a view given by its centre and width.
  function scene(view, { trial, run, frame }, [x, y], width) {
    const { outline_um, wire_um, base_um, truth_um } = trial;
    const { contact_um, ellipse, surface_um } = run;
    const height = width * 3 / 4;
    view.setAttribute("viewBox", `${x - width / 2} ${-y - height / 2} ${width} ${height}`);
    view.replaceChildren();
    if (outline_um.length) draw(view, "path", { class: "object", d: line(outline_um) });
    const [contact, truth, axes] = [contact_um[frame], truth_um[frame], ellipse[frame]];
    if (wire_um[frame]) draw(view, "path", { class: "wire", d: smooth(wire_um[frame].map(([x, y]) => [x, -y])) });
    const [baseX, baseY] = base_um[frame];
    draw(view, "path", { class: "base", "stroke-linecap": "square", d: `M${baseX} ${-baseY}h0` });
    draw(view, "path", { class: "found", d: dots(surface_um.slice(0, frame + 1)) });
    if (truth) {
      draw(view, "path", { class: "truth", d: dots([truth]) });
      draw(view, "path", { class: "core", d: dots([truth]) });
    }
    if (contact && axes) {
      const place = `translate(${contact[0]} ${-contact[1]}) rotate(${-axes[2] / 10})`;
      draw(view, "ellipse", { class: "ellipse", rx: axes[0], ry: axes[1], transform: place });
    }
    if (contact) draw(view, "path", { class: "estimate", d: dots([contact]) });
  }

  // Centre and width of a view that contains the path of the base and all shapes of the whisker.
  function whole({ trial }) {
    const spots = [...trial.base_um, ...trial.wire_um.flat()].filter(Boolean);
    const [left, right, low, high] = [0, 1].flatMap(k => {
      const values = spots.map(spot => spot[k]);
      return [Math.min(...values), Math.max(...values)];
    });
    return [[(left + right) / 2, (low + high) / 2], 1.1 * Math.max(right - left, (high - low) * 4 / 3)];
  }

  return { scene, whole };
}
