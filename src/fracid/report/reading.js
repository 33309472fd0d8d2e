"use strict";
// A table from a text of any dialect, as fracid.recording.readers.text reads it: the pair of delimiter and decimal sign
// under which most lines are numbers.  Nothing throws: what cannot be read is { error }.

const Reading = (() => {
  const BLANK = new Set(["", "nan", "-nan", "na", "n/a", "null", "none", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind"]);
  const NUMBER = { ".": /^[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?$/i, ",": /^[+-]?(?:\d+(?:,\d+)?|,\d+)(?:e[+-]?\d+)?$/i };
  const STAMP = /^(?:(\d{4})-(\d\d)-(\d\d)[ T])?(\d{1,2}):(\d\d):(\d\d(?:\.\d+)?)Z?$/;
  const COMMENT = /^\s*(?:#|%|\/\/)/, WORDS = { ",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", "": "blanks" };
  const MOST = { characters: 1 << 26, line: 1 << 18, columns: 1000, name: 100 };
  const DIALECTS = [false, true].flatMap(stamped => [[",", "."], [";", ","], [";", "."], ["\t", "."], ["\t", ","], ["", "."], ["", ","], ["|", "."], ["|", ","], [",", ","]].map(([delimiter, decimal]) => ({ delimiter, decimal, stamped })));

  function quoted(line, delimiter) {
    const cells = [];
    let cell = "", inside = false;
    for (const c of line) {
      if (c === '"') inside = !inside;
      else if (c === delimiter && !inside) { cells.push(cell); cell = ""; } else cell += c;
    }
    return [...cells, cell].map(text => text.trim());
  }

  const split = ({ delimiter }, line) => (delimiter === "" ? line.trim().split(/\s+/).map(c => c.replace(/^"|"$/g, "")) : line.includes('"') ? quoted(line, delimiter) : line.split(delimiter).map(c => c.trim()));

  const stampOf = cell => {
    const found = STAMP.exec(cell);
    if (!found) return NaN;
    const [year, month, day, hours, minutes, seconds] = found.slice(1).map(v => Number(v || 0));
    return (year ? Date.UTC(year, month - 1, day) / 1000 : 0) + 3600 * hours + 60 * minutes + seconds;
  };
  const isNumber = (d, cell) => NUMBER[d.decimal].test(cell) || (d.stamped && STAMP.test(cell));
  const isText = (d, cell) => !isNumber(d, cell) && !BLANK.has(cell.toLowerCase());
  const numberOf = (d, cell) => (NUMBER[d.decimal].test(cell) ? Number(d.decimal === "," ? cell.replace(",", ".") : cell) : d.stamped ? stampOf(cell) : NaN);
  const isRow = (d, width, cells) => cells.length === width && cells.some(c => isNumber(d, c)) && !cells.some(c => isText(d, c));

  // The dialect and its count of cells.
  function sniff(lines) {
    const every = Math.max(1, Math.floor(lines.length / 100)), sample = lines.filter((_, k) => k % every === 0).slice(0, 200), top = lines.slice(0, 5);
    let best = null, most = 0;
    for (const d of DIALECTS) {
      const counts = new Map();
      for (const line of sample) {
        const cells = split(d, line);
        if (isRow(d, cells.length, cells)) counts.set(cells.length, (counts.get(cells.length) || 0) + 1);
      }
      for (const [width, hits] of counts) {
        const titled = top.some(line => { const cells = split(d, line); return cells.length === width && cells.every(c => isText(d, c)); });
        if (hits + 0.5 * titled > most) [best, most] = [{ ...d, width }, hits + 0.5 * titled];
      }
    }
    return best;
  }

  const short = text => JSON.stringify(text.length > 60 ? `${text.slice(0, 60)} …` : text);

  // Names and units of the columns: the last lines of that many words above the numbers, rather no comments.
  function titles(d, header) {
    const rows = header.map(line => ({ plain: !COMMENT.test(line), cells: split(d, line.replace(/^\s*(?:[#%]|\/\/)+\s*/, "")) }));
    const fit = rows.filter(({ cells }) => cells.length === d.width && cells.some(c => isText(d, c)));
    const named = fit.find(row => row.plain) || fit[0];
    if (!named) return { names: [], units: [] };
    const below = rows[rows.indexOf(named) + 1];
    return { names: named.cells, units: below && fit.includes(below) ? below.cells : [] };
  }

  // "alpha [deg]", "alpha (deg)", "alpha, deg": the unit.
  const unitIn = text => (/[[(]([^\])]*)[\])]\s*$/.exec(text) || /,\s*([^\s,]+)\s*$/.exec(text) || ["", ""])[1].trim();

  function parse(text, name = "the text") {
    if (text.length > MOST.characters) return { error: `${name} has more than ${MOST.characters >> 20} million characters; fracid check FILE reads it.` };
    const lines = text.split(/\r\n|\n|\r/), counts = [];
    if (text.includes("\0")) return { error: `${name} is no text: it holds zero bytes. For .mat, .xlsx and other formats: fracid open FILE.` };
    for (let k = 0; k < lines.length; k++) {
      if (lines[k].length > MOST.line) return { error: `${name}, line ${k + 1} has ${lines[k].length} characters. Time must run downwards, one row for each sample.` };
      if (lines[k].trim() && !COMMENT.test(lines[k])) counts.push(k);
    }
    const d = sniff(counts.map(k => lines[k]));
    const first = d ? counts.findIndex(k => isRow(d, d.width, split(d, lines[k]))) : -1;
    if (first < 0) return { error: `${name} holds no row of numbers. Expected numbers like 0.01 or −1.5e-3, a row for each sample, names above them.` };
    if (d.width > MOST.columns) return { error: `${name} has ${d.width} columns; this page takes ${MOST.columns}.` };
    const rows = counts.slice(first), columns = Array.from({ length: d.width }, () => new Float64Array(rows.length));
    for (let n = 0; n < rows.length; n++) {
      const cells = split(d, lines[rows[n]]);
      if (cells.length !== d.width) return { error: `${name}, line ${rows[n] + 1}: ${cells.length} cells where other lines have ${d.width}. Complete, correct or delete it.` };
      for (let c = 0; c < d.width; c++) {
        const v = numberOf(d, cells[c]);
        if (v !== v && !BLANK.has(cells[c].toLowerCase())) return { error: `${name}, line ${rows[n] + 1}, column ${c}: ${short(cells[c])} is not a number. Correct it or leave it blank.` };
        columns[c][n] = v;
      }
    }
    const { names, units } = titles(d, lines.slice(0, rows[0]));
    const called = columns.map((_, c) => (names[c] || `column ${c}`).slice(0, MOST.name));
    const last = d.width - 1;
    if (d.width > 1 && !names[last] && columns[last].every(v => v !== v)) { columns.pop(); called.pop(); } // a delimiter at each line's end
    return { name, names: called, units: called.map((title, c) => unitIn(units[c] ? `[${units[c].slice(0, MOST.name).replace(/^[[(]|[\])]$/g, "")}]` : title)), columns, rows: rows.length, said: `cells between ${WORDS[d.delimiter]}, decimal ${d.decimal === "," ? "comma" : "point"}` };
  }

  // Bytes as text, whatever the encoding.
  function decode(bytes) {
    const marks = [[0xff, 0xfe, "utf-16le"], [0xfe, 0xff, "utf-16be"]].find(([a, b]) => bytes[0] === a && bytes[1] === b);
    try {
      return new TextDecoder(marks ? marks[2] : "utf-8", { fatal: true }).decode(bytes);
    } catch {
      return new TextDecoder("windows-1252").decode(bytes);
    }
  }

  return { parse, decode };
})();
