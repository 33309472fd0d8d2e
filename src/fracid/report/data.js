"use strict";
// What a page's scripts share: its numbers, its elements by name, and whether its reader wants no motion.

const DATA = JSON.parse(document.getElementById("samples").textContent);
const element = id => document.getElementById(id);
const CALM = matchMedia("(prefers-reduced-motion: reduce)");
