"use strict";
// What the pages do beyond forms and links: copying, events of the server, plots. Nothing is fetched from elsewhere.
(() => {
  const $ = (selector, within = document) => within.querySelector(selector);
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const data = document.body.dataset;

  for (const button of all("[data-copy]")) {
    button.hidden = !navigator.clipboard;
    button.addEventListener("click", async () => {
      await navigator.clipboard.writeText($("code", button.parentElement).textContent);
      button.textContent = "Copied";
    });
  }

  // A command at work: its lines, the stage it is in, and how long those took the last time.
  const work = () => {
    const log = $("#log"), bar = $("progress"), state = $("#state"), stages = all("[data-stage]");
    const events = new EventSource(`/events/work?key=${encodeURIComponent(data.key)}`);
    let current = null, began = 0;
    log.textContent = "";
    const enter = (stage, done) => {
      if (current) { current.className = "done"; current.removeAttribute("aria-current"); }
      if (done) { stage.className = "done"; $("span", stage).textContent = "up to date"; return; }
      // those that were passed over
      for (const s of stages.slice(0, stages.indexOf(stage))) if (!s.className) { s.className = "done"; $("span", s).textContent = "nothing to do"; }
      current = stage; began = performance.now();
      current?.setAttribute("aria-current", "step");
    };
    const left = share => {
      if (!current) return "";
      const spent = (performance.now() - began) / 1000, last = Number(current.dataset.seconds);
      const own = share > 0.02 ? spent * (1 - share) / share : last - spent;
      const later = stages.slice(stages.indexOf(current) + 1).reduce((sum, s) => sum + Number(s.dataset.seconds), 0);
      const seconds = Math.max(own, 0) + later, ever = stages.some(s => Number(s.dataset.seconds));
      return last || share ? `, about ${seconds < 90 ? `${Math.ceil(seconds)} s` : `${Math.round(seconds / 60)} min`} left${ever ? "" : ` of ${current.dataset.stage}`}` : "";
    };
    events.addEventListener("lines", event => {
      for (const line of JSON.parse(event.data)) {
        const stage = stages.find(s => line.startsWith(s.dataset.stage.padEnd(9))), part = /(\d+) of (\d+)/.exec(line);
        if (stage) enter(stage, line.trimEnd().endsWith("up to date"));
        bar.hidden = !part;
        if (part) bar.value = part[1] / part[2];
        state.textContent = line.trim().slice(0, 120) + left(part ? part[1] / part[2] : 0);
        log.append(`${line}\n`);
      }
      log.scrollTop = log.scrollHeight;
    });
    events.addEventListener("ended", event => {
      const { code, result } = JSON.parse(event.data);
      events.close();
      bar.hidden = $("#cancel").hidden = true;
      if (current) { current.className = "done"; current.removeAttribute("aria-current"); }
      state.textContent = { 0: "done", 3: "done, some trials rejected", 130: "cancelled; finished products stand" }[code] ?? `refused (${code}): its last lines say why`;
      $("#result").hidden = !(result && [0, 3].includes(code));
      if (!$("#result").hidden && !sessionStorage.getItem(data.key)) { sessionStorage.setItem(data.key, "1"); location.href = result; }
    });
  };

  const node = (name, text = "", ...children) => { const made = document.createElement(name); made.textContent = text; made.append(...children); return made; };
  const svg = (name, attributes) => { const made = document.createElementNS("http://www.w3.org/2000/svg", name); for (const [k, v] of Object.entries(attributes)) made.setAttribute(k, v); return made; };
  const short = (x, digits = 3) => (x === null || x === undefined ? "" : Number(x).toPrecision(digits).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, ""));

  const ticks = (low, high) => {
    const rough = (high - low || 1) / 4, ten = 10 ** Math.floor(Math.log10(rough)), step = ten * [1, 2, 5, 10].find(s => s * ten >= rough);
    return Array.from({ length: 7 }, (_, k) => (Math.ceil(low / step) + k) * step).filter(v => v <= high + 1e-9 * step);
  };
  const rounds = (low, high) => [0.01, 0.1, 1, 10, 100].flatMap(ten => [1, 2, 5].map(s => s * ten)).filter(v => v >= low && v <= high);

  // Points of several series, a line and its band; the point nearest to the pointer is told beneath.
  const plot = (place, { series, line = [], log = false, x: across, y: up, title }) => {
    const [W, H, L, B] = [640, 340, 64, 42], every = series.flatMap(s => s.points);
    const xs = [...every.map(p => p[0]), ...line.map(p => p[0])], ys = [...every.map(p => p[1]), ...line.map(p => p[1])];
    if (!xs.length) { place.replaceChildren(); return; }
    const least = v => v.reduce((a, b) => Math.min(a, b)), most = v => v.reduce((a, b) => Math.max(a, b));
    const f = log && least(xs) > 0 ? Math.log : v => v, g = f === Math.log ? Math.exp : v => v;
    const [x0, x1] = [f(least(xs)), f(most(xs))], [y0, y1] = [least(ys), most(ys)], room = 0.06 * (y1 - y0 || 1);
    const X = v => L + (W - L - 12) * (f(v) - x0) / (x1 - x0 || 1), Y = v => H - B - (H - B - 12) * (v - y0 + room) / (y1 - y0 + 2 * room);
    const drawn = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": `${title}: ${every.length} points, ${up} from ${short(y0)} to ${short(y1)} over ${across} from ${short(least(xs))} to ${short(most(xs))}` });
    for (const v of f === Math.log ? rounds(least(xs), most(xs)) : ticks(x0, x1)) {
      const under = svg("text", { x: X(v), y: H - B + 18, "text-anchor": "middle" });
      under.textContent = short(v);
      drawn.append(under);
    }
    for (const h of ticks(y0, y1)) {
      const left = svg("text", { x: L - 6, y: Y(h) + 4, "text-anchor": "end" });
      left.textContent = short(h);
      drawn.append(svg("path", { class: "grid", d: `M${L} ${Y(h)}H${W - 12}` }), left);
    }
    const label = svg("text", { x: (W + L) / 2, y: H - 4, "text-anchor": "middle" }), side = svg("text", { x: 14, y: (H - B) / 2, "text-anchor": "middle", transform: `rotate(-90 14 ${(H - B) / 2})` });
    label.textContent = across; side.textContent = up;
    drawn.append(label, side);
    if (line.length) {
      if (line[0].length > 3) drawn.append(svg("path", { class: "band", d: `M${line.map(p => `${X(p[0])} ${Y(p[2])}`).join("L")}L${[...line].reverse().map(p => `${X(p[0])} ${Y(p[3])}`).join("L")}Z` }));
      drawn.append(svg("path", { class: "line", d: `M${line.map(p => `${X(p[0])} ${Y(p[1])}`).join("L")}` }));
    }
    series.forEach((s, i) => drawn.append(svg("path", { class: s.cross ? "cross" : `dots s${i % 6}`, d: s.points.map(p => (s.cross ? `M${X(p[0]) - 4} ${Y(p[1]) - 4}l8 8m0 -8l-8 8` : `M${X(p[0])} ${Y(p[1])}h0`)).join("") })));
    const told = node("figcaption"), key = node("p", "");
    key.className = "key";
    series.forEach((s, i) => { const one = node("span", s.name); one.className = s.cross ? "cross" : `s${i % 6}`; key.append(one, " "); });
    drawn.addEventListener("pointermove", event => {
      const box = drawn.getBoundingClientRect(), px = (event.clientX - box.x) * W / box.width, py = (event.clientY - box.y) * H / box.height;
      const near = every.map(p => [(X(p[0]) - px) ** 2 + (Y(p[1]) - py) ** 2, p]).reduce((a, b) => (b[0] < a[0] ? b : a), [400, null])[1];
      told.textContent = near ? near[2] : "";
    });
    place.replaceChildren(node("h3", title), drawn, key, told);
  };

  // A campaign while it is recorded.
  const live = () => {
    const trials = new Map(), campaign = encodeURIComponent(data.campaign);
    let far = {}, found = { codes: {}, curves: {}, residuals: {} }, waiting = false;
    const places = new Map();
    const figure = (within, name) => {
      const key = `${within.id || within.parentElement.id} ${name}`;
      if (!places.has(key)) { const made = node("figure"); made.dataset.boundary = name; within.append(made); places.set(key, made); }
      return places.get(key);
    };
    const codes = t => [...new Set([...t.codes, ...(found.codes[t.trial]?.codes ?? [])])].filter(c => c !== "MISSING" || t.lift === null);
    const said = t => [...new Set([t.said, found.codes[t.trial]?.said].filter(Boolean).join("; ").split("; "))].join("; ");
    const draw = () => {
      waiting = false;
      const landed = [...trials.values()].filter(t => t.lift !== null);
      for (const boundary of new Set(landed.map(t => t.boundary).filter(b => b !== "none"))) {
        const level = t => far[boundary]?.[Number(t.throttle.toPrecision(6))] ?? far.none?.[Number(t.throttle.toPrecision(6))];
        const own = landed.filter(t => t.boundary === boundary && t.z !== null && level(t)), bad = t => codes(t).some(c => c === c.toUpperCase());
        const point = t => [t.z, 100 * (t.lift / level(t) - 1), `${t.trial}: ẑ ${short(t.z)}, ${short(100 * t.throttle)} %, ${short(1e3 * t.lift, 4)} mN ${codes(t).join(" ")}`];
        const by = [...new Set(own.map(t => t.throttle))].sort((a, b) => a - b);
        const series = by.map(h => ({ name: `${short(100 * h)} %`, points: own.filter(t => t.throttle === h && !bad(t)).map(point) }));
        const good = series.flatMap(s => s.points.map(p => p[1])), wrong = own.filter(bad).map(point).filter(p => !good.length || Math.abs(p[1]) < 5 * Math.max(...good.map(Math.abs), 1));
        if (wrong.length) series.push({ name: "rejected", cross: true, points: wrong });
        plot(figure($("#fig2"), boundary), { series, line: found.curves[boundary] ?? [], log: true, x: "ẑ = distance / rotor radius", y: "ΔL (%)", title: boundary });
      }
      $("#trials tbody").replaceChildren(...landed.sort((a, b) => b.at - a.at || b.i - a.i).slice(0, 60).map(t => {
        const row = node("tr", "", node("th", t.trial), node("td", t.boundary), node("td", t.z === null ? "free air" : short(t.z)), node("td", `${short(100 * t.throttle)} %`), node("td", `${short(1e3 * t.lift, 4)} ± ${short(1e3 * t.u, 2)}`), node("td", codes(t).join(" ") || "good"));
        row.firstChild.scope = "row";
        row.dataset.trial = t.trial;
        return row;
      }));
      const odd = landed.filter(t => codes(t).length).map(t => `trial ${t.trial}: ${codes(t).join(" ")}: ${t.fault || said(t)}`);
      const listed = [...(found.suspects ?? []), ...odd];
      $("#odd").hidden = !listed.length;
      $("#odd ul").replaceChildren(...listed.slice(-12).map(text => node("li", text)), ...(listed.length > 12 ? [node("li", `and ${listed.length - 12} more`)] : []));
    };
    const soon = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };
    const residuals = () => {
      const names = [...new Set(Object.values(found.residuals).flatMap(Object.keys))], menu = $("#residuals select"), kept = menu.value;
      $("#residuals").hidden = !names.length;
      menu.replaceChildren(...names.map(n => { const o = node("option", n); o.selected = n === kept; return o; }));
      for (const [boundary, own] of Object.entries(found.residuals)) {
        const points = (own[menu.value] ?? []).map(([x, y, trial]) => [x, y, `${trial}: ${short(x)}, ${short(y)} %`]);
        plot(figure($("#residuals .views"), boundary), { series: [{ name: "trials", points }], x: menu.value, y: "residual (%)", title: boundary });
      }
    };
    const ask = async event => {
      if (event?.submitter?.name === "as") return;
      event?.preventDefault();
      const given = new URLSearchParams(new FormData($("#next")));
      if (!given.get("for")) return;
      $("#visits").textContent = "Asking";
      const told = await (await fetch(`/next?${given}`)).json(), code = node("p", "", node("code", told.command ?? ""));
      code.className = "command";
      if (told.refusal) { const refused = node("p", told.refusal); refused.className = "refusal"; $("#visits").replaceChildren(code, refused); return; }
      $("#visits").replaceChildren(code, ...Object.entries(told.boundaries).flatMap(([boundary, own]) => [
        node("h3", boundary), ...own.text.map(line => node("p", line)),
        node("ol", "", ...own.visits.map(v => node("li", `${typeof v.z_hat === "number" ? `${short(1e3 * v.distance_m, 4)} mm` : "free air"}${v.supply_V ? ` at ${v.supply_V.toFixed(2)} V` : ""}: ${v.throttles.map(h => short(100 * h)).join(", ")} %${typeof v.via_m === "number" ? `, coming from ${short(1e3 * v.via_m, 4)} mm` : ""}`))),
      ]), ...told.notes.map(line => node("p", line)));
    };
    const look = async () => {
      found = await (await fetch(`/looked?campaign=${campaign}`)).json();
      $("#verdicts").replaceChildren(...found.verdicts.map(v => { const card = node("section", "", node("h3", v.boundary), node("p", v.headline), node("p", v.claim), node("p", v.paid), node("p", v.leaning)); card.className = "card tile"; return card; }));
      const wanted = [...new Set(found.verdicts.flatMap(v => v.coefficients))];
      $("#questions").replaceChildren(...[...wanted, "separate", "drift"].map(q => node("option", q)));
      if (!$("#next [name=for]").value && wanted.length) $("#next [name=for]").value = wanted[0];
      residuals(); soon();
    };
    const events = new EventSource(`/events/live?campaign=${campaign}`);
    events.addEventListener("trials", event => {
      const told = JSON.parse(event.data), now = performance.now();
      if (told.fresh) trials.clear();
      far = told.far;
      for (const t of told.trials) trials.set(t.i, { ...t, at: trials.has(t.i) ? trials.get(t.i).at : now });
      $("#state").textContent = `${[...trials.values()].filter(t => t.lift !== null).length} of ${told.scheduled} trials have landed`;
      $("#refusal").hidden = !told.refusal; $("#refusal").textContent = told.refusal;
      soon();
    });
    events.addEventListener("look", event => { const told = JSON.parse(event.data); $("#state").textContent = told.refused || told.words; if (!told.refused) look().then(() => $("#visits").childElementCount && ask()); });
    $("#residuals select").addEventListener("change", residuals);
    $("#next").addEventListener("submit", ask);
    // rivals stop where they part
    $("#next [name=for]").addEventListener("input", event => { $("#next [name=until]").disabled = /^(separate|drift)/.test(event.target.value); });
    look();
  };

  // Dropped records, one after the other; then the form makes the campaign of them.
  const fresh = () => {
    const form = $("#fresh"), list = $("#taken"), own = $("[name=name]", form), queue = [];
    let busy = false, given = 0, there = 0;
    const tell = () => { $("#count").textContent = given ? `${there} of ${given} files are there` : ""; };
    const fault = text => { const line = node("li", text); line.className = "refusal"; list.append(line); };
    const next = async () => {
      if (busy || !queue.length || !own.reportValidity()) return;
      busy = true;
      const file = queue.shift(), answer = await fetch(`/upload?name=${encodeURIComponent(own.value)}&file=${encodeURIComponent(file.name)}`, { method: "POST", body: file }).catch(() => null);
      if (answer?.ok) there += 1;
      else fault(`${file.name}: ${answer ? (await answer.json()).refusal : "the server has gone"}`);
      busy = false;
      tell();
      next();
    };
    const take = files => { queue.push(...files); given += files.length; tell(); next(); };
    // of a folder its own plain files, as `nearlift new --from FOLDER` takes them
    const within = async folder => {
      const reader = folder.createReader(), files = [];
      for (let some; (some = await new Promise((done, no) => reader.readEntries(done, no))).length;) files.push(...some);
      return Promise.all(files.filter(f => f.isFile && !f.name.startsWith(".")).map(f => new Promise((done, no) => f.file(done, no))));
    };
    $("#files").addEventListener("change", event => take(event.target.files));
    own.addEventListener("change", next);
    for (const name of ["dragover", "drop"]) addEventListener(name, event => event.preventDefault());
    addEventListener("drop", async event => {
      const entries = [...event.dataTransfer.items].map(i => i.webkitGetAsEntry?.()), files = [...event.dataTransfer.files];
      take(files.filter((_, i) => !entries[i]?.isDirectory));
      for (const folder of entries.filter(e => e?.isDirectory)) take(await within(folder));
    });
    form.addEventListener("submit", event => { if (busy || queue.length) { event.preventDefault(); fault("wait until all are there"); } });
  };

  // Manifest and form side by side, each editing the other; what is refused stands at its field.
  const edit = () => {
    const manifest = $("#manifest"), schedule = $("#schedule"), fields = $("#fields"), state = $("#state"), campaign = data.campaign;
    const said = state.textContent;
    let timer = 0, last = Promise.resolve(), rows = new Map(), values = {}, shown = [], typed = "";
    const post = async (where, given) => (await fetch(where, { method: "POST", body: new URLSearchParams({ campaign, manifest: manifest.value, schedule: schedule.value, ...given }) })).json();
    const field = ({ key, value, choices, remark }) => {
      const label = node("label", `${key} `), box = choices.length ? node("select") : node("input"), told = node("span"), note = node("span", remark);
      if (choices.length) box.append(...[...new Set([value, ...choices])].map(c => { const o = node("option", c); o.selected = c === value; return o; }));
      else box.value = value;
      box.dataset.key = key; box.id = `field ${key}`; label.htmlFor = box.id; told.className = "refusal"; told.id = `fault ${key}`; note.className = "note"; note.id = `note ${key}`;
      box.addEventListener("focus", () => { if (/FILL IN/.test(box.value)) box.select?.(); });
      box.addEventListener("change", () => check({ set: key, value: box.value }));
      return node("p", "", label, box, told, note);
    };
    // one after the other, so that no edit is made to a text that lacks the one before
    const check = given => { last = last.then(() => checked(given ?? {})).catch(() => { state.textContent = "the server has gone"; }); return last; };
    const checked = async given => {
      const sent = manifest.value, found = await post("/check", given);
      // typed on meanwhile: what was set is set in that, and what was typed has its own check
      if (manifest.value !== sent) { if (given.set) await checked(given); return; }
      manifest.value = found.manifest;
      values = Object.fromEntries(found.fields.map(f => [f.key, f.value]));
      // one that stays is left where it is, and keeps the focus and what is being typed
      for (const [key, row] of rows) if (!(key in values)) { row.remove(); rows.delete(key); }
      found.fields.forEach((f, i) => { if (!rows.has(f.key)) { rows.set(f.key, field(f)); fields.insertBefore(rows.get(f.key), fields.children[i] ?? null); } });
      for (const f of found.fields) { const box = document.getElementById(`field ${f.key}`); if (box !== document.activeElement) box.value = f.value; document.getElementById(`fault ${f.key}`).textContent = ""; box.removeAttribute("aria-invalid"); }
      const loose = [];
      cells.faults(found.refusals.filter(r => r.line).map(r => ({ ...r, id: "fault-of-a-cell" })));
      for (const r of found.refusals) {
        const box = document.getElementById(`field ${r.key}`);
        if (!box) { loose.push(r); continue; }
        document.getElementById(`fault ${r.key}`).textContent = r.text;
        box.setAttribute("aria-invalid", "true"); box.setAttribute("aria-describedby", `fault ${r.key}`);
      }
      $("#faults").replaceChildren(...loose.map(r => {
        const p = node("p", `${r.line ? `trials.csv, line ${r.line}${r.column && `, ${r.column}`}:` : r.key} ${r.text} `), show = node("button", "Show the cell");
        p.className = "refusal"; show.type = "button";
        if (r.line) { p.id = "fault-of-a-cell"; show.addEventListener("click", cells.show); p.append(show); }
        return p;
      }));
      const text = manifest.value + schedule.value;
      typed ||= text;
      state.textContent = `${text === typed ? said && `${said}; ` : "not saved yet; "}${found.refusals.length ? `${found.refusals.length} to mend` : `${found.trials} trials; nothing is refused`}`;
      $("#reads").textContent = found.reads;
      if (shown.file !== found.file) await record(found.file);
      draw();
    };
    const soon = () => { clearTimeout(timer); timer = setTimeout(() => check(), 300); };
    const cells = grid($("#grid"), schedule, soon);
    const record = async file => {
      shown = file ? await (await fetch(`/channels?campaign=${encodeURIComponent(campaign)}&file=${encodeURIComponent(file)}`)).json() : [];
      shown.file = file;
      $("#channels").hidden = !shown.length;
      $("#channels select").replaceChildren(...shown.map(c => { const o = node("option", c.name); o.selected = c.name === values["records.force.column"]; return o; }));
    };
    const draw = () => {
      const own = shown.find(c => c.name === $("#channels select").value);
      if (!own) return;
      const rate = parseFloat(values["load_cell.sample_rate"]) || own.rate || 0, unit = rate ? "s" : "samples", by = rate || 1;
      const points = own.points.map(([i, y]) => [i / by, y, `${short(i / by)} ${unit}: ${short(y, 5)} ${own.unit}`]), last = points.at(-1)[0], tare = parseFloat(values["load_cell.tare"]) || 0;
      const slide = $("#tare");
      slide.disabled = !rate;
      slide.max = last; slide.step = last / 1000 || 1;
      if (slide !== document.activeElement) slide.value = tare;
      $("#channels output").textContent = rate ? `${short(Number(slide.value))} s` : "once load_cell.sample_rate is given";
      const cut = points.findIndex(p => p[0] >= Number(slide.value));
      plot($("#channels figure"), { series: [{ name: "tare", points: points.slice(0, cut) }, { name: "lift", points: points.slice(cut) }], x: rate ? "time (s)" : "sample", y: `${own.name} (${own.unit || "?"})`, title: shown.file });
    };
    manifest.addEventListener("input", soon);
    schedule.addEventListener("input", soon);
    $("#no-row").addEventListener("click", cells.withoutRow);
    $("#no-column").addEventListener("click", cells.withoutColumn);
    $("#undo").addEventListener("click", cells.undo);
    $("#channels select").addEventListener("change", draw);
    $("#tare").addEventListener("input", draw);
    $("#tare").addEventListener("change", () => check({ set: "load_cell.tare", value: `${short(Number($("#tare").value), 4)} s` }));
    $("#channels figure").addEventListener("pointerdown", event => {
      if (!event.target.closest("svg") || $("#tare").disabled) return;
      // every move draws it anew
      const move = e => { const box = $("#channels svg").getBoundingClientRect(), share = ((e.clientX - box.x) * 640 / box.width - 64) / (640 - 76); $("#tare").value = share * $("#tare").max; $("#tare").focus(); draw(); };
      const stop = () => { removeEventListener("pointermove", move); $("#tare").dispatchEvent(new Event("change")); };
      move(event);
      addEventListener("pointermove", move);
      addEventListener("pointerup", stop, { once: true });
    });
    $("#force").addEventListener("click", async () => {
      const own = shown.find(c => c.name === $("#channels select").value);
      await check({ set: "records.force.column", value: own.name });
      if (own.unit && /^(mN|N|kN|gf|kgf|lbf|ozf)$/.test(own.unit)) await check({ set: "records.force.unit", value: own.unit });
    });
    check();
  };

  ({ work, live, fresh, edit })[data.page]?.();
})();
