"""The files of a results folder, and the fault that every program tells in one line; nothing here takes time to load."""

RESULT_FILES = {
    "history": "history.txt",
    "energy": "energy.txt",
    "motion": "motion.txt",
    "static": "static.txt",
    "modes": "modes.txt",
    "frequency_response": "frequency_response.txt",
}
TABLES = {"csv": ".csv", "parquet": ".parquet", "matlab": ".mat"}  # suffix of each format of a table


class HistoryError(Exception):
    """A results file that is missing or damaged, or a column that it does not have."""
