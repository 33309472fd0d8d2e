"""What an accessibility check asks for beside the theme: what scrolls takes the keyboard, captions have a level."""


def _page(_app, _name, _template, context, _doctree):
    if "body" in context:
        context["body"] = context["body"].replace("<pre>", '<pre tabindex="0">')
    menu = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = menu.replace('role="heading"', 'role="heading" aria-level="2"')


def setup(app):
    """Look at each page after the theme has made its menu."""
    app.connect("html-page-context", _page, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
