"use strict";
// Light, dark, or as the system has it: the dark colours are a style sheet of their own, and this says when it holds.  The
// choice is kept for the next page, where the browser keeps anything of a file's.
{
  const THEMES = { system: "screen and (prefers-color-scheme: dark)", light: "not all", dark: "screen" }, KEY = "fracid-theme";
  const select = document.getElementById("theme");
  const kept = does => { try { return does(localStorage); } catch { return null; } }; // private windows refuse
  const show = () => { document.getElementById("dark").media = THEMES[select.value]; };
  const before = kept(storage => storage.getItem(KEY));
  if (Object.hasOwn(THEMES, before)) select.value = before;
  select.addEventListener("change", () => { show(); kept(storage => storage.setItem(KEY, select.value)); });
  select.closest("label").hidden = false;
  show();
}
