"""How accurate our own state is under faults, and how soon they are named. `study` runs it."""
