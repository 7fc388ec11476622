"""A course for teachers: exercises with templates, and checks that measure an answer by running it."""
