"""Selection: which structure?  Friction models of growing complexity, with orders 1 and with orders free."""
