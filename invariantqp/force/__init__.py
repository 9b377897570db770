"""Force and motion at once: contacts' tasks, wrench sensors, the hybrid controller."""
