"use strict";
// Comma-separated text as a table of cells. The text is the file: what nobody touches in the table stays as it is written.
const grid = (table, box, changed) => {
  // of each row of cells: how it is written, how it ends, and the line that it ends on; `above` are remarks and blank lines before the names
  let rows = [], above = "", past = [];
  const write = cell => (/[",\r\n]/.test(cell) ? `"${cell.replaceAll('"', '""')}"` : cell);
  const lines = text => text.split(/\r\n|\r|\n/).length - 1;

  const read = text => {
    const remarks = /^(?:[ \t]*(?:#[^\r\n]*)?(?:\r\n|\r|\n))*/.exec(text)[0], cell = /("(?:[^"]|"")*"|[^,\r\n]*)(,|\r\n|\r|\n|$)/y;
    above = remarks; rows = [];
    let line = lines(remarks);
    for (let at = remarks.length; at < text.length;) {
      const begin = at, cells = [];
      let end = ",";
      while (end === ",") {
        cell.lastIndex = at;
        const found = cell.exec(text);
        cells.push(found[1].startsWith('"') && found[1].length > 1 ? found[1].slice(1, -1).replaceAll('""', '"') : found[1]);
        at += found[0].length; end = found[2];
      }
      const raw = text.slice(begin, at - end.length);
      line += lines(raw) + 1;
      rows.push({ cells, raw, end, line });
    }
  };
  const blank = row => row.cells.every(c => !c.trim());
  const width = () => Math.max(0, ...rows.slice(0, 1).map(r => r.cells.length));
  const shown = () => rows.filter((r, i) => !i || !blank(r));
  const text = () => above + rows.map(r => r.raw + r.end).join("");
  const keep = () => { if (past.at(-1) !== box.value) past.push(box.value); past = past.slice(-100); };
  const told = () => { box.value = text(); changed(); };

  // What a cell holds. One beyond the last row or name makes a new one.
  const set = (row, column, value) => {
    while (rows.length <= row) {
      const last = rows.at(-1);
      if (last && !last.end) last.end = "\n";
      rows.push({ cells: [], raw: "", end: "\n", line: (last?.line ?? lines(above)) + 1 });
    }
    rows[row].cells[column] = value;
    const wide = Math.max(width(), column + 1);
    for (const own of column >= width() || row === 0 ? rows : [rows[row]]) {
      if (own !== rows[row] && (blank(own) || own.cells.length >= wide)) continue;
      own.cells = Array.from({ length: Math.max(wide, own.cells.length) }, (_, i) => own.cells[i] ?? "");
      own.raw = blank(own) ? "" : own.cells.map(write).join(",");
    }
  };

  const made = (name, content, scope) => { const cell = document.createElement(name); cell.textContent = content; if (scope) cell.scope = scope; return cell; };
  // a cell's row among `rows`, and its column
  const place = cell => [Number(cell.parentElement.dataset.row), cell.cellIndex - 1];
  const cellAt = (row, column) => table.querySelector(`tr[data-row="${row}"]`)?.cells[column + 1];
  const line = (at, wide) => {
    const row = document.createElement("tr"), own = rows[at], name = at ? "td" : "th";
    row.dataset.row = at;
    row.append(made("th", own?.line ?? (rows.at(-1)?.line ?? 0) + 1, "row"));
    for (let i = 0; i <= wide; i += 1) { const cell = made(name, own?.cells[i] ?? "", at ? "" : "col"); cell.tabIndex = -1; row.append(cell); }
    return row;
  };
  const draw = () => {
    const wide = Math.max(width(), ...rows.map(r => r.cells.length)), body = document.createElement("tbody"), head = document.createElement("thead");
    head.append(line(0, wide));
    body.append(...rows.flatMap((r, i) => (i && !blank(r) ? [line(i, wide)] : [])), line(Math.max(rows.length, 1), wide));
    table.replaceChildren(head, body);
    active(head.rows[0].cells[1]);
  };
  const active = cell => { table.querySelector("[tabindex='0']")?.setAttribute("tabindex", "-1"); cell.tabIndex = 0; };
  const go = cell => { cell?.focus(); cell?.scrollIntoView({ block: "nearest", inline: "nearest" }); return Boolean(cell); };
  const anew = () => { read(box.value); draw(); };

  table.addEventListener("focusin", ({ target }) => {
    if (target.cellIndex === undefined) return;
    active(target);
    keep();
    target.contentEditable = "plaintext-only";
    getSelection().selectAllChildren(target);
  });
  table.addEventListener("focusout", ({ target }) => { target.removeAttribute("contenteditable"); });
  table.addEventListener("input", ({ target }) => {
    const [row, column] = place(target);
    set(row, column, target.textContent);
    target.removeAttribute("aria-invalid");
    delete target.dataset.fault;
    // there is always one more row and column to type into
    const body = table.tBodies[0], wide = table.rows[0].cells.length - 2;
    if (column >= wide) for (const own of table.rows) { const cell = made(own.dataset.row === "0" ? "th" : "td", ""); cell.tabIndex = -1; own.append(cell); }
    if (row >= Number(body.lastElementChild.dataset.row)) body.append(line(rows.length, table.rows[0].cells.length - 2));
    told();
  });
  table.addEventListener("keydown", event => {
    const cell = event.target, row = cell.parentElement, chosen = getSelection(), whole = chosen.toString() === cell.textContent;
    const every = [...table.rows], over = step => every[every.indexOf(row) + step]?.cells[cell.cellIndex];
    const beside = step => { const other = row.cells[cell.cellIndex + step]; return other?.tabIndex === undefined || other === row.cells[0] ? null : other; };
    const edge = last => whole || (chosen.isCollapsed && chosen.anchorOffset === (last ? chosen.anchorNode.textContent.length : 0));
    const to = { ArrowUp: () => over(-1), ArrowDown: () => over(1), Enter: () => over(event.shiftKey ? -1 : 1), Tab: () => beside(event.shiftKey ? -1 : 1), ArrowLeft: () => edge(false) && beside(-1), ArrowRight: () => edge(true) && beside(1) }[event.key]?.();
    if ((event.ctrlKey || event.metaKey) && event.key === "z") { event.preventDefault(); undo(); }
    else if (go(to || null) || event.key === "Enter") event.preventDefault();
  });
  table.addEventListener("paste", event => {
    const pasted = event.clipboardData.getData("text/plain").replace(/(\r\n|\r|\n)$/, ""), each = pasted.split(/\r\n|\r|\n/), names = each[0].split(/[\t,]/).map(n => n.trim());
    event.preventDefault();
    keep();
    let [row, column] = place(event.target);
    // with its names above it, it becomes the table
    if (names.includes("boundary")) {
      const tabs = each[0].includes("\t");
      read((tabs ? each.map(l => l.split("\t").map(write).join(",")) : each).join("\n") + "\n");
      [row, column] = [0, 0];
    } else {
      each.forEach((l, i) => l.split("\t").forEach((value, k) => set(row + i, column + k, value)));
    }
    draw();
    told();
    go(cellAt(row, column));
  });
  const undo = () => {
    // what stands there now is the last that was kept, unless something was typed since
    while (past.length && past.at(-1) === box.value) past.pop();
    if (!past.length) return;
    const at = place(table.querySelector("[tabindex='0']"));
    box.value = past.pop();
    anew();
    changed();
    go(cellAt(...at) ?? cellAt(0, 0));
  };
  const without = (row, column) => {
    keep();
    if (row !== null) rows.splice(row, 1);
    else for (const own of rows) if (column < own.cells.length) { own.cells.splice(column, 1); own.raw = own.cells.map(write).join(","); }
    box.value = text();
    anew();
    changed();
  };
  const chosen = () => place(table.querySelector("[tabindex='0']"));
  box.addEventListener("change", anew);
  anew();

  return {
    undo,
    withoutRow: () => { const [row, column] = chosen(); if (!rows[row]) return; without(row, null); go(cellAt(row, column) ?? cellAt(0, 0)); },
    withoutColumn: () => { const [row, column] = chosen(); if (column >= width()) return; without(null, column); go(cellAt(row, column) ?? cellAt(0, 0)); },
    // Each fault at its cell; where a line has no such column at its first.
    faults: list => {
      for (const cell of table.querySelectorAll("[data-fault]")) { delete cell.dataset.fault; cell.removeAttribute("aria-invalid"); cell.removeAttribute("aria-describedby"); }
      list.forEach(({ line: at, column, text: said, id }) => {
        const row = rows.findIndex(r => r.line === at), cell = cellAt(row, Math.max(rows[0]?.cells.findIndex(c => c.trim() === column) ?? 0, 0));
        if (!cell) return;
        cell.dataset.fault = said;
        cell.setAttribute("aria-invalid", "true");
        cell.setAttribute("aria-describedby", id);
      });
    },
    show: () => go(table.querySelector("[data-fault]")),
  };
};
