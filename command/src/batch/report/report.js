"use strict";
(() => {
  const at = id => document.getElementById(id);
  for (const controls of document.querySelectorAll(".controls")) controls.hidden = false;

  const chart = at("chart");
  const choose = () => {
    document.querySelectorAll(".chart").forEach((box, k) => { box.hidden = k !== Number(chart.value); });
  };
  if (chart) { chart.addEventListener("change", choose); choose(); }

  const table = at("jobs"), body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
  const rows = [...body.rows], filter = at("filter"), by = at("sort"), down = at("down");
  const pictures = [...document.querySelectorAll("figure[data-job]")];
  const key = (row, k) => {
    const cell = row.cells[k];
    return "value" in cell.dataset ? Number(cell.dataset.value) : cell.textContent;
  };
  // Empty cells are last in either direction.
  const compare = (a, b, sign) => {
    if (a === "" || b === "") return (a === "") - (b === "");
    const numbers = typeof a === "number" && typeof b === "number";
    return sign * (numbers ? a - b : String(a).localeCompare(String(b), "en", { numeric: true }));
  };
  let sorted = false;
  const show = () => {
    const words = filter.value.toLowerCase().split(/\s+/).filter(word => word);
    const shown = new Set();
    for (const row of rows) {
      const text = [...row.cells].map(cell => `${cell.dataset.name}=${cell.textContent}`).join(" ").toLowerCase();
      row.hidden = !words.every(word => text.includes(word));
      if (!row.hidden) shown.add(row.cells[0].textContent);
    }
    if (sorted) {
      const k = Number(by.value), sign = down.checked ? -1 : 1;
      body.append(...rows.slice().sort((a, b) => compare(key(a, k), key(b, k), sign)));
      heads.forEach((head, i) => head.ariaSort = i !== k ? "none" : down.checked ? "descending" : "ascending");
    }
    for (const picture of pictures) picture.hidden = !shown.has(picture.dataset.job);
    at("count").textContent = `${shown.size} of ${rows.length} jobs`;
  };
  const sort = () => { sorted = true; show(); };
  filter.addEventListener("input", show);
  by.addEventListener("change", sort);
  down.addEventListener("change", sort);
  heads.forEach((head, k) => head.addEventListener("click", () => {
    down.checked = sorted && Number(by.value) === k && !down.checked;
    by.value = k;
    sort();
  }));
  show();
})();
