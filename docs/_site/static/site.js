// The page that is open stands in the middle of the menu, however long that is.
addEventListener("DOMContentLoaded", () => {
  const menu = document.querySelector(".sidebar-scroll"), here = menu?.querySelector("li.current-page");
  if (here) menu.scrollTop = here.getBoundingClientRect().top - menu.getBoundingClientRect().top - menu.clientHeight / 2;
});
