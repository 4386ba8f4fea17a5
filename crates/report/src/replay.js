// Plays one trial: two views of the scene, and the error with a cursor. The script before this one defines `stageOf`, which draws
// the scene. Data: `Trial` in replay.rs, in whole micrometres in World, one entry a frame, null if absent.
"use strict";
{
  const part = Object.fromEntries(
    [...document.querySelectorAll("#replay [data-part]")].map(element => [element.dataset.part, element]));
  const trials = JSON.parse(part.trials.textContent);
  const margin = { left: 62, right: 12, top: 10, bottom: 28 };
  const chartHeight = 170;
  const slide = 0.5; // seconds per frame with reduced motion

  let frame = 0;
  let playing = null; // { since: ms, from: s } while it plays
  const trial = () => trials[part.trial.selectedIndex];
  const run = () => trial().runs[part.estimator.selectedIndex];
  const last = () => trial().t_s.length - 1;

  // An element of SVG in a parent, with its attributes.
  function draw(parent, name, attributes, text) {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    return parent.appendChild(element);
  }

  // A smooth line through points at equal distances (Catmull and Rom).
  function smooth(spots) {
    const at = index => spots[Math.min(Math.max(index, 0), spots.length - 1)];
    const curves = spots.slice(1).map((to, i) => {
      const [before, from, after] = [at(i - 1), at(i), at(i + 2)];
      const out = [0, 1].map(k => from[k] + (to[k] - before[k]) / 6);
      const back = [0, 1].map(k => to[k] - (after[k] - from[k]) / 6);
      return `C${out.join(" ")} ${back.join(" ")} ${to.join(" ")}`;
    });
    return `M${spots[0].join(" ")}` + curves.join("");
  }

  // Centre of the detail: the true contact or else the estimated one, at this frame, the last before or the first after it.
  function focus({ trial, run, frame }) {
    const seen = index => trial.truth_um[index] ?? run.contact_um[index];
    for (let index = frame; index >= 0; index--) if (seen(index)) return seen(index);
    for (let index = frame; index <= last(); index++) if (seen(index)) return seen(index);
    return trial.base_um[frame];
  }

  // The chart's scales: seconds, and micrometres in decades from a hundredth of a millimetre to a hundred.
  function scales() {
    const width = part.error.clientWidth;
    const [from, to] = [trial().t_s[0], trial().t_s[last()]];
    return {
      width,
      x: t => margin.left + (t - from) / (to - from) * (width - margin.left - margin.right),
      y: um => {
        const share = (Math.log10(Math.min(Math.max(um, 10), 1e5)) - 1) / 4;
        return chartHeight - margin.bottom - share * (chartHeight - margin.top - margin.bottom);
      },
    };
  }

  function chart() {
    const { width, x, y } = scales();
    part.error.setAttribute("viewBox", `0 0 ${width} ${chartHeight}`);
    part.error.replaceChildren();
    for (const um of [10, 100, 1e3, 1e4, 1e5]) {
      draw(part.error, "line", { class: "grid", x1: margin.left, x2: width - margin.right, y1: y(um), y2: y(um) });
      const label = um / 1000 + (um === 1e5 ? " mm" : "");
      draw(part.error, "text", { x: margin.left - 8, y: y(um) + 4, "text-anchor": "end" }, label);
    }
    const end = trial().t_s[last()];
    const every = [0.5, 1, 2, 5, 10, 20, 50, 100].find(step => end / step <= width / 60) ?? end;
    for (let t = Math.ceil(trial().t_s[0] / every) * every; t < end - every / 2; t += every) {
      draw(part.error, "text", { x: x(t), y: chartHeight - 9, "text-anchor": "middle" }, String(t));
    }
    draw(part.error, "text", { x: width - margin.right, y: chartHeight - 9, "text-anchor": "end" }, "s");
    const curve = errors => errors.map((um, i) => um === null ? "" :
      `${i && errors[i - 1] !== null ? "L" : "M"}${x(trial().t_s[i]).toFixed(1)} ${y(um).toFixed(1)}`).join("");
    for (const other of trial().runs) {
      if (other !== run()) draw(part.error, "path", { class: "other", d: curve(other.error_um) });
    }
    draw(part.error, "path", { class: "own", d: curve(run().error_um) });
    draw(part.error, "line", { class: "cursor", y1: margin.top, y2: chartHeight - margin.bottom });
    draw(part.error, "circle", { class: "dot", r: 5 });
  }

  function show() {
    const now = { trial: trial(), run: run(), frame };
    stage.scene(part.overview, now, ...stage.whole(now));
    stage.scene(part.closeup, now, focus(now), 1000 * part.zoom.value);
    const { x, y } = scales();
    const t = trial().t_s[frame];
    const um = run().error_um[frame];
    const cursor = part.error.querySelector(".cursor");
    cursor.setAttribute("x1", x(t));
    cursor.setAttribute("x2", x(t));
    const dot = part.error.querySelector(".dot");
    dot.setAttribute("visibility", um === null ? "hidden" : "visible");
    dot.setAttribute("cx", x(t));
    dot.setAttribute("cy", y(um ?? 10));
    part.time.value = frame;
    const error = um !== null ? `, error ${(um / 1000).toFixed(um < 1000 ? 3 : 1)} mm`
      : run().contact_um[frame] ? "" : ", no estimate";
    part.now.value = `${t.toFixed(2)} s${error}`;
    part.time.setAttribute("aria-valuetext", part.now.value);
  }

  function pause() {
    playing = null;
    part.play.textContent = "Play";
  }

  function play(from) {
    playing = { since: performance.now(), from };
    part.play.textContent = "Pause";
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const mine = playing;
    requestAnimationFrame(function tick(now) {
      if (playing !== mine) return;
      const seconds = Math.max(now - mine.since, 0) / 1000;
      const times = trial().t_s;
      const next = still ? mine.from + 5 * Math.floor(seconds / slide)
        : times.findLastIndex(t => t <= times[mine.from] + seconds);
      const reached = Math.min(next, last());
      if (reached !== frame) {
        frame = reached;
        show();
      }
      if (frame === last()) pause();
      else requestAnimationFrame(tick);
    });
  }

  function choose() {
    pause();
    const name = part.estimator.value;
    part.estimator.replaceChildren(...trial().runs.map(run => new Option(run.name, run.name)));
    const kept = trial().runs.findIndex(run => run.name === name);
    part.estimator.selectedIndex = Math.max(kept, 0);
    part.time.max = last();
    frame = Math.round(last() / 2);
    chart();
    show();
  }

  part.trial.replaceChildren(...trials.map(trial => new Option(trial.name)));
  part.trial.addEventListener("change", choose);
  part.estimator.addEventListener("change", () => { chart(); show(); });
  part.zoom.addEventListener("change", show);
  part.time.addEventListener("input", () => { pause(); frame = Number(part.time.value); show(); });
  part.play.addEventListener("click", () => playing ? pause() : play(frame === last() ? 0 : frame));
  new ResizeObserver(() => { chart(); show(); }).observe(part.error);
  const stage = stageOf(part, { draw, smooth }, () => show());
  choose();
}
