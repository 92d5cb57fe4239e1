"""Files of recorded data, whatever their kind, as recordings."""
import difflib
import os
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

from shsa_core.errors import ModelError
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_learning.recordings.attribution import attributed
from shsa_learning.recordings.bags import is_bag, read_bag
from shsa_learning.recordings.csv_files import read_csv
from shsa_learning.recordings.recording import Recording, Series


def read(
    paths: Sequence[str], som: Optional[Som] = None, ontology: Optional[Ontology] = None
) -> Tuple[Recording, ...]:
    """The recordings in some files: rosbags, which need a SOM, and CSV files.

    A bag is a recording. CSV files are sources of one recording, unless they cannot be: those of
    one name in several folders are a recording each folder, and so are those that do not overlap in
    time. Which services they are of, `attributed` says. Raises ShsaError, with the file, if one
    cannot be read.
    """
    if not paths:
        raise ModelError("the data", "no file is given")
    twice = [path for k, path in enumerate(paths) if path in paths[:k]]
    if twice:
        raise ModelError(twice[0], "is given twice")
    recordings: List[Recording] = []
    tables: List[str] = []
    for path in paths:
        if not is_bag(path):
            tables.append(path)
        elif som is None:
            raise ModelError(path, "is a rosbag: a SOM (--som) says what its topics provide")
        else:
            recordings.append(read_bag(path, som))
    return (*recordings, *_recordings(tables, som or Som(), ontology))


class _Table(NamedTuple):
    """What one CSV file holds."""

    path: str
    series: Tuple[Series, ...]
    notes: Tuple[str, ...]

    @property
    def begin(self) -> float:
        return min(series.begin for series in self.series)

    @property
    def end(self) -> float:
        return max(series.end for series in self.series)


def _recordings(
    paths: Sequence[str], som: Som, ontology: Optional[Ontology]
) -> Tuple[Recording, ...]:
    tables = []
    for path in paths:
        series, notes = read_csv(path)
        tables.append(_Table(path, series, notes))
    folders: Dict[str, List[_Table]] = {}
    names = [os.path.basename(path) for path in paths]
    apart = len(set(names)) < len(names)
    for table in tables:
        folder = os.path.dirname(os.path.abspath(table.path)) if apart else ""
        folders.setdefault(folder, []).append(table)
    found = []
    for group in folders.values():
        parts = _overlapping(group)
        for part in parts:
            said = [note for table in part for note in table.notes]
            if len(parts) > 1:
                span = f"{part[0].begin:g} to {max(table.end for table in part):g} s"
                said.append(f"{part[0].path} ({span}) is a recording apart: no overlap in time")
            named, more = attributed([table.series for table in part], som)
            all_ = tuple(series for table in named for series in table)
            said += more
            said += _unknown(all_, ontology)
            name = part[0].path if len(part) == 1 else os.path.commonpath([t.path for t in part])
            found.append(Recording(name or part[0].path, all_, tuple(said)))
    return tuple(found)


def _overlapping(tables: Sequence[_Table]) -> List[List[_Table]]:
    """The tables in groups that overlap in time, earliest first."""
    groups: List[List[_Table]] = []
    end = 0.0
    for table in sorted(tables, key=lambda each: each.begin):
        if groups and table.begin <= end:
            groups[-1].append(table)
            end = max(end, table.end)
        else:
            groups.append([table])
            end = table.end
    return groups


def _unknown(series: Sequence[Series], ontology: Optional[Ontology]) -> List[str]:
    """What is named as no property of the ontology is."""
    if ontology is None:
        return []
    notes = []
    for each in series:
        if each.property not in ontology.properties:
            near = difflib.get_close_matches(each.property, ontology.properties, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            notes.append(f"{each.source}: {each.property} is no property of the ontology{hint}")
    return notes
