"use strict";
// The table of all runs: sorted by a heading, filtered, and two chosen ones side by side.
{
  const body = document.querySelector("#runs tbody"), rows = [...body.rows], filters = [...document.querySelectorAll("#filters [name]")];
  const value = (row, key) => row.dataset[key] ?? "";

  for (const select of filters.filter(f => f.tagName === "SELECT")) {
    for (const one of [...new Set(rows.map(row => value(row, select.name)))].filter(Boolean).sort()) select.add(new Option(one));
  }

  const passes = {
    text: (row, typed) => row.textContent.toLowerCase().includes(typed.toLowerCase()),
    since: (row, day) => value(row, "started") >= day,
    error: (row, most) => row.dataset.error !== "" && Number(row.dataset.error) <= Number(most),
  };

  function show() {
    const chosen = rows.filter(row => row.querySelector("input").checked);
    const beside = chosen.length === 2;
    for (const row of rows) {
      row.hidden = filters.some(f => f.value && !(passes[f.name] ? passes[f.name](row, f.value) : value(row, f.name) === f.value));
      row.querySelector("input").disabled = beside && !chosen.includes(row);
      document.getElementById(row.dataset.card).hidden = beside ? !chosen.includes(row) : row.hidden;
    }
    document.querySelector(".cards").classList.toggle("beside", beside);
    document.getElementById("count").textContent = beside ? "Two are side by side below." : `${rows.filter(row => !row.hidden).length} of ${rows.length}; choose two to see them side by side.`;
  }

  for (const button of document.querySelectorAll("#runs thead button")) {
    button.addEventListener("click", () => {
      const head = button.closest("th"), rising = head.getAttribute("aria-sort") !== "ascending", key = button.value;
      for (const other of document.querySelectorAll("#runs thead [aria-sort]")) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", rising ? "ascending" : "descending");
      const number = key === "error", of = row => (number ? Number(value(row, key) || Infinity) : value(row, key));
      const order = (a, b) => (number ? of(a) - of(b) || 0 : of(a).localeCompare(of(b)));
      rows.sort((a, b) => (rising ? order(a, b) : order(b, a)));
      body.append(...rows);
    });
  }
  for (const control of [...filters, ...rows.map(row => row.querySelector("input"))]) control.addEventListener("input", show);
  document.getElementById("filters").hidden = false;
  show();
}
