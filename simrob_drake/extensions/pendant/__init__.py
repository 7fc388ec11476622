"""The teach pendant: a page in the browser to teach, push, tune and watch any robot."""
