"""The robot in the browser: live view, replay."""
