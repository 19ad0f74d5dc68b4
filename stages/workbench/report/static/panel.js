// What stands beside the 3D view: title, choices, legend, table of keypoints.
"use strict";

(() => {
  const part = (name) => document.getElementById(`viewer-${name}`);

  function subtitle(row) {
    const facts = [row.category];
    if (row.points) facts.push(`${row.kind}, ${row.points} candidates`);
    if (row.auc != null) facts.push(`AUC ${row.auc.toFixed(3)}`);
    if (row.iou10 != null) facts.push(`IoU .10 ${row.iou10.toFixed(2)}`);
    if (row.confidence != null) facts.push(`confidence ${row.confidence.toFixed(2)}`);
    if (row.of_class != null) facts.push(`of class ${row.of_class.toFixed(2)}`);
    if (row.shot.length) facts.push(`shot in draw ${row.shot.join(", ")}`);
    return facts.join(" · ");
  }

  function fillDraws(shape, chosen) {   // returns the draw whose prediction is shown
    const options = shape.attempts.map((attempt) => {
      const auc = attempt.iou && attempt.iou.reduce((a, b) => a + b, 0) / attempt.iou.length;
      return new Option(`draw ${attempt.draw}${auc == null ? "" : `: AUC ${auc.toFixed(3)}`}`, attempt.draw);
    });
    part("draw").replaceChildren(...(options.length ? options : [new Option("no prediction", "")]));
    part("draw").disabled = options.length < 2;
    const draws = shape.attempts.map((attempt) => attempt.draw), wanted = chosen ?? b23d.data.draw;
    const draw = draws.includes(wanted) ? wanted : (draws[0] ?? null);
    if (draw !== null) part("draw").value = draw;
    return draw;
  }

  function fillOthers(row) {
    const others = b23d.data.rows.filter((other) => other.category === row.category && other.name !== row.name && other.details);
    part("other").replaceChildren(new Option("nothing", ""), ...others.map((other) => new Option(other.id, other.name)));
    part("other").disabled = !others.length;
  }

  function legend(field, hint) {
    const scalar = field.values !== null;
    part("bar").hidden = !scalar;
    if (scalar) {
      part("gradient").style.background = b23d.fields.gradient(field.map);
      part("low").textContent = Number(field.low.toFixed(2));
      part("high").textContent = Number(field.high.toFixed(2));
    }
    part("legend").textContent = hint || [field.label, field.note].filter(Boolean).join(". ");
  }

  /** What people call a keypoint: its id, and the name that the annotation has for it. */
  const called = (shape, id) => {
    const name = (b23d.data.names[shape.category] || {})[id];
    return id < 0 ? "–" : name ? `${id} ${name}` : String(id);
  };

  function keypoints(shape, attempt) {
    const truth = new Set(shape.truth.map((k) => k.id)), found = new Set(attempt ? attempt.keypoints.map((k) => k.id) : []);
    const lines = attempt ? attempt.keypoints.map((k) => [k.id, k.present ? (truth.has(k.id) ? "" : "not annotated") : "judged absent", k.error, k.confidence, k.cost]) : [];
    for (const k of shape.truth) if (!found.has(k.id)) lines.push([k.id, attempt ? "not predicted" : "annotated", null, null, null]);
    const ofClass = attempt?.ofClass ?? null;
    part("of-class").textContent = ofClass == null ? "" : `of class ${ofClass.toFixed(2)}${ofClass < 0.5 ? ": it may be none of them, and sure means little" : ""}`;
    part("keypoints").replaceChildren(...lines.map(([id, note, error, confidence, cost]) => {
      const line = document.createElement("tr");
      const color = id < 0 ? "#808080" : b23d.data.idColors[id % b23d.data.idColors.length];
      line.append(...[called(shape, id), error == null ? note : `${error.toFixed(3)}${note ? ` ${note}` : ""}`, confidence == null ? "" : confidence.toFixed(2), cost == null ? "" : cost.toFixed(2)].map((text) => {
        const cell = document.createElement("td");
        cell.textContent = text;
        return cell;
      }));
      line.firstChild.style.setProperty("--dot", color);
      return line;
    }));
  }

  b23d.panel = { called, subtitle, fillDraws, fillOthers, legend, keypoints };
})();
