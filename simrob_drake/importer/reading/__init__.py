"""From a file to the ``robot`` element in it: tolerant of form, strict about safety."""
