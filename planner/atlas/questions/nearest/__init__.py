"""The nearest pose that an arm reaches."""
