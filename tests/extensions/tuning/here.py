"""An engine that works in this process: others take a second to begin."""

import pickle


class Here:
    """Works on what another process would be sent."""

    def __enter__(self):
        """Return itself."""
        return self

    def __exit__(self, *_):
        """Nothing is left."""

    def outcomes(self, work, tasks, died):
        """Yield what becomes of each task."""
        return (work(pickle.loads(pickle.dumps(task))) for task in tasks)
