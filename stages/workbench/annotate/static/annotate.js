// The page: what is placed, what comes next, undo, save. States are never changed, only replaced; undo goes back to an earlier one.
"use strict";

(async () => {
  const element = (id) => document.getElementById(id);
  const json = async (path, body) => {
    const options = body && { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
    const answer = await fetch(path + window.location.search, options), value = await answer.json();
    if (!answer.ok) throw Object.assign(new Error(value.error), { conflict: answer.status === 409, stale: value.stale });
    return value;
  };
  const say = (text, kind = "") => { element("status").textContent = text; element("status").className = kind; };
  const page = await json("state").catch((error) => say(error.message, "bad"));
  if (!page) return;

  // A keypoint: { uid, id, name, unit, normal, hit }; hit: where it was clicked, null as loaded. saved: uid → { id in the file, name, hit }.
  let given = page.given, uid = 0, saved = new Map(), reference = null, state = { keypoints: [], next: 0 }, selected = null, written = state.keypoints, walk = page.walk, tips = false;
  const past = [], future = [];
  const MISS = 8;   // pixels that a click may lie beside the surface
  const called = (id) => (page.ids.find((line) => line.id === id) || {}).name || "";   // what the class's other shapes call it
  const full = (id, name) => (name ? `${id} (${name})` : `${id}`);
  const color = (id) => page.colors[id % page.colors.length];
  const colored = (list) => list.map((k) => ({ ...k, color: color(k.id), told: `${full(k.id, k.name)}  ${(k.hit || k.at).xyz.join("  ")}` }));

  const adopt = (keypoints) => keypoints.map((k) => ({ uid: uid++, id: k.id, name: k.name, unit: k.unit, normal: null, hit: null, at: k.at }));
  const remember = (list) => { saved = new Map(list.map((k) => [k.uid, { id: k.id, name: k.name, hit: k.hit }])); written = list; };

  const known = () => [...new Set([...page.ids.map((line) => line.id), ...(reference ? reference.keypoints.map((k) => k.id) : [])])].sort((a, b) => a - b);
  function free(keypoints, from = 0) {
    const used = new Set(keypoints.map((k) => k.id)), open = known().filter((id) => !used.has(id));
    if (open.length) return open.find((id) => id >= from) ?? open[0];
    return Math.max(-1, ...used, ...known()) + 1;
  }

  function change(keypoints, next, words) {
    past.push(state);
    future.length = 0;
    state = { keypoints, next };
    if (!keypoints.some((k) => k.uid === selected)) selected = null;
    say(words);
    draw();
  }
  function travel(from, to, words) {
    if (!from.length) return say(`nothing to ${words}`);
    to.push(state);
    state = from.pop();
    selected = null;
    say(words);
    draw();
  }
  const undo = () => travel(past, future, "undo"), redo = () => travel(future, past, "redo");

  let busy = false;
  async function click(ray, event) {
    if (busy) return;
    busy = true;
    try {
      const hit = await json("hit", { ...ray, within: MISS * target.pixel(), extremity: tips });
      const far = hit ? Math.hypot(...hit.unit.map((x, i) => x - ray.origin[i])) : Infinity;
      const ball = event.shiftKey ? null : target.met(ray, far);
      if (ball) return select(ball.uid);
      if (!hit) return say("the click missed the shape");
      const place = { unit: hit.unit, normal: hit.normal, hit: { xyz: hit.xyz, mesh_info: hit.mesh_info, pcd_info: hit.pcd_info } };
      const moved = state.keypoints.find((k) => (event.shiftKey ? k.uid === selected : k.id === state.next));
      if (event.shiftKey && !moved) return say("select the keypoint to move first: click it, or its line in the list");
      if (moved) return change(state.keypoints.map((k) => (k === moved ? { ...k, ...place } : k)), event.shiftKey ? state.next : free(state.keypoints, state.next), `moved ${moved.id}`);
      const keypoints = [...state.keypoints, { uid: uid++, id: state.next, name: called(state.next), ...place }];
      change(keypoints, free(keypoints, state.next), `placed ${full(state.next, called(state.next))}`);
    } catch (error) {
      say(error instanceof TypeError ? "no answer: is b23d annotate still running?" : error.message, "bad");
    } finally {
      busy = false;
    }
  }

  function select(which) {
    selected = selected === which ? null : which;
    draw();
  }
  function remove(which) {
    const gone = state.keypoints.find((k) => k.uid === which);
    if (gone) change(state.keypoints.filter((k) => k !== gone), gone.id, `deleted ${gone.id}`);
  }
  function rename(which, text) {
    const id = Number(text), own = state.keypoints.find((k) => k.uid === which), other = state.keypoints.find((k) => k.id === id && k !== own);
    if (text === "" || !Number.isInteger(id) || id < 0 || id >= 2 ** 31) {
      say("an id is a whole number of 0 or more", "bad");
      return draw();
    }
    if (id === own.id) return;
    const renumbered = (k, to) => ({ ...k, id: to, name: k.name === called(k.id) ? called(to) : k.name });   // the class's name goes with the id
    const keypoints = state.keypoints.map((k) => (k === own ? renumbered(k, id) : k === other ? renumbered(k, own.id) : k));
    change(keypoints, free(keypoints), other ? `${own.id} and ${id} have changed ids` : `${own.id} is now ${id}`);
  }
  function call(which, text) {
    const own = state.keypoints.find((k) => k.uid === which), name = text.trim();
    if (name !== own.name) change(state.keypoints.map((k) => (k === own ? { ...k, name } : k)), state.next, name ? `${own.id} is called ${name}` : `${own.id} has no name now`);
  }
  function choose(id) {
    state = { ...state, next: Math.min(Math.max(Math.trunc(id) || 0, 0), 2 ** 31 - 1) };
    draw();
  }
  /** The id before or after among those of the class; beyond them one by one. */
  function step(by) {
    const ids = known(), beyond = Math.max(-1, ...ids);
    const found = by > 0 ? ids.find((id) => id > state.next) ?? Math.max(state.next, beyond) + 1 : ids.filter((id) => id < state.next).pop() ?? Math.max(state.next - 1, 0);
    choose(by < 0 && state.next > beyond + 1 ? state.next - 1 : found);
  }

  async function save(force = false) {
    const keypoints = state.keypoints.map((k) => {
      const before = saved.get(k.uid);
      return { id: k.id, was: before ? before.id : null, hit: before && before.hit === k.hit && !force ? null : k.hit || k.at,
        ...(before && before.name === k.name && !force ? {} : { name: k.name }) };
    });
    const list = state.keypoints;
    try {
      const answer = await json("save", { keypoints, given, force });
      given = answer.given;
      walk = answer.walk;
      remember(list);
      say(answer.message, "good");
      draw();
      return true;
    } catch (error) {
      if (error.stale) {
        say(`not saved: ${error.message}. `, "bad");
        const reload = () => { written = state.keypoints; window.location.reload(); };
        element("status").append(button("Reload theirs", reload), " ", button("Save mine", () => save(true)));
        return;
      }
      if (error.conflict && window.confirm(`${error.message}.\n\nSave anyway?`)) return save(true);
      say(error instanceof TypeError ? "not saved: no answer; is b23d annotate still running?" : `not saved: ${error.message}`, "bad");
    }
  }

  /** Show the shape before or after; what is not saved is saved first. */
  async function go(name) {
    if (!name) return say("no further shape");
    if (state.keypoints !== written && !(await save())) return;
    window.location.search = `?shape=${encodeURIComponent(name)}`;
  }
  const previous = () => go(walk.previous), following = () => go(walk.next);
  function aim() {
    tips = !tips;
    draw();
  }

  const button = (text, act, title) => Object.assign(document.createElement("button"), { type: "button", textContent: text, onclick: act, title: title || "" });

  function draw() {
    const { keypoints, next } = state, used = new Set(keypoints.map((k) => k.id)), dirty = keypoints !== written;
    const chosen = keypoints.find((k) => k.uid === selected);
    target.paint(colored(keypoints), chosen ? chosen.id : null);
    if (reference) {
      const wanted = chosen ? chosen.id : next, has = reference.keypoints.some((k) => k.id === wanted);
      referenceView.paint(colored(reference.keypoints), wanted);
      element("reference-hint").textContent = has ? `drawn large: id ${wanted}, ${chosen ? "the selected one" : "to be placed next"}` : `this reference has no id ${wanted}`;
    }
    document.querySelectorAll(".next-id").forEach((place) => { place.textContent = `id ${full(next, called(next))}`; });
    element("next").value = next;
    element("undo").disabled = !past.length;
    element("redo").disabled = !future.length;
    element("save").disabled = !dirty;
    element("tips").setAttribute("aria-pressed", tips);
    element("walk").textContent = walk.told;
    for (const [id, name] of [["previous", walk.previous], ["following", walk.next]]) {
      element(id).disabled = !name;
      element(id).title = name ? `${name} (${id === "previous" ? "P" : "N"}); saves first` : "no further shape";
    }
    const missing = page.ids.filter((line) => !used.has(line.id));
    element("missing").hidden = !missing.length || !keypoints.length;
    element("missing").textContent = `missing here: ${missing.map((line) => full(line.id, line.name)).join(", ")}. Pass over what the shape lacks.`;
    element("count").textContent = `${keypoints.length}${dirty ? ", not saved" : ""}`;
    document.title = `${dirty ? "• " : ""}${page.name} – b23d annotate`;
    element("known").replaceChildren(...known().map((id) => {
      const line = page.ids.find((other) => other.id === id), chip = button(id, () => choose(id), `${called(id) ? `${called(id)}, ` : ""}on ${line ? line.count : 1} of ${page.peers} annotated shapes`);
      chip.className = [used.has(id) && "placed", id === next && "next"].filter(Boolean).join(" ");
      chip.style.setProperty("--dot", color(id));
      return chip;
    }));
    element("known-title").textContent = known().length ? "ids of this class; filled: placed here" : "no other shape of this class is annotated yet";
    element("keypoints").replaceChildren(...[...keypoints].sort((a, b) => a.id - b.id).map(row));
    const line = document.querySelector("tr.selected");
    if (line) line.scrollIntoView({ block: "nearest" });
  }

  function row(k) {
    const line = document.createElement("tr"), where = (k.hit || k.at).xyz.join("  ");   // as saved: all its digits
    const id = Object.assign(document.createElement("input"), { type: "number", min: 0, step: 1, value: k.id, title: "change the id; one that is taken is exchanged" });
    const name = Object.assign(document.createElement("input"), { type: "text", maxLength: 80, value: k.name, placeholder: called(k.id) || "name", className: "name", title: k.name || "what people call it" });
    const place = Object.assign(document.createElement("div"), { className: "place", textContent: where, title: "source frame, as saved" });
    const [fields, actions] = [0, 1].map(() => line.insertCell()), disc = document.createElement("i");
    name.setAttribute("aria-label", `name of keypoint ${k.id}`);
    name.onchange = () => call(k.uid, name.value);
    name.onclick = (event) => event.stopPropagation();
    id.setAttribute("aria-label", `id of keypoint ${k.id}`);
    id.onchange = () => rename(k.uid, id.value);
    id.onclick = (event) => event.stopPropagation();
    line.style.setProperty("--dot", color(k.id));
    line.className = k.uid === selected ? "selected" : "";
    line.onclick = () => select(k.uid);
    fields.append(disc, id, name, place);
    actions.append(button("✕", (event) => { event.stopPropagation(); remove(k.uid); }, "delete"));
    return line;
  }

  const KEYS = {
    "ctrl+s": () => (element("save").disabled ? say("nothing to save") : save()),
    "ctrl+z": undo, u: undo, "ctrl+shift+z": redo, "ctrl+y": redo, "shift+u": redo,
    delete: () => remove(selected), backspace: () => remove(selected), escape: () => select(null),
    n: () => following(), p: () => previous(), e: aim,
    "]": () => step(1), arrowright: () => step(1), "[": () => step(-1), arrowleft: () => step(-1),
  };
  function key(event) {
    const command = event.ctrlKey || event.metaKey, letter = event.key.length > 1 || /[a-z]/i.test(event.key);   // ] may need Shift or Alt to type
    const name = (command ? "ctrl+" : "") + (event.shiftKey && letter ? "shift+" : "") + event.key.toLowerCase();
    if (!KEYS[name] || (event.target.matches("input, select") && name !== "ctrl+s")) return;
    event.preventDefault();
    KEYS[name]();
  }

  let turned = false;   // by hand: then the view stays as it is
  const target = new b23d.View(element("target"), click, (camera) => { turned = true; return referenceView.follow(camera); });
  const referenceView = new b23d.View(element("reference"), (ray) => {
    const ball = referenceView.met(ray, Infinity);
    if (ball) choose(ball.id);
  }, (camera) => { turned = true; return target.follow(camera); });

  async function lookAt(name) {
    try {
      reference = await json(`reference/${encodeURIComponent(name)}`);
      element("reference-side").hidden = false;
      await referenceView.show(reference.shape, target.camera);
      if (turned) return;
      const farther = referenceView.fitted(reference.shape, target.camera);   // both are whole, and seen from one place
      await Promise.all([target, referenceView].map((view) => view.follow(farther)));
    } catch (error) {
      reference = null;
      say(error.message, "bad");
    }
  }

  element("name").textContent = page.name;
  element("file").textContent = element("file").title = `saves to ${page.file}`;
  element("references").append(...page.references.map((name) => new Option(name.split("/").slice(1).join("/"), name, name === page.reference, name === page.reference)));
  element("references").onchange = async (event) => { event.target.blur(); await lookAt(event.target.value); draw(); };
  element("undo").onclick = undo;
  element("redo").onclick = redo;
  element("save").onclick = () => save();
  element("previous").onclick = previous;
  element("following").onclick = following;
  element("tips").onclick = aim;
  element("theme").onclick = b23d.theme.toggle;
  element("earlier").onclick = () => step(-1);
  element("later").onclick = () => step(1);
  element("next").onchange = (event) => { choose(Number(event.target.value)); event.target.blur(); };
  document.addEventListener("keydown", key);
  window.addEventListener("beforeunload", (event) => { if (state.keypoints !== written) event.preventDefault(); });
  b23d.theme.onChange(draw);

  if (page.reference) element("reference-side").hidden = false;
  await target.show(page.shape);
  if (page.reference) await lookAt(page.reference);
  remember(adopt(page.keypoints));
  state = { keypoints: written, next: free(written) };
  draw();
  Object.assign(b23d, { target, referenceView, ready: true });
})();
