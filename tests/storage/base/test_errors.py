import pickle

from storage.base.errors import CorruptStoreError


def test_the_damaged_file_is_known_in_other_processes_too() -> None:
    for file in ("shards/abc", None):
        error = pickle.loads(pickle.dumps(CorruptStoreError("shards/abc is damaged", file)))
        assert (str(error), error.file) == ("shards/abc is damaged", file)
