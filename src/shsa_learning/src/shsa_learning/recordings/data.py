"""Files of recorded data, whatever their kind, as recordings."""
import dataclasses
import os
from typing import Dict, List, NamedTuple, Optional, Sequence, Set, Tuple

from shsa_core.errors import ModelError
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.text import nearest
from shsa_learning.recordings.bags import is_bag
from shsa_learning.recordings.csv_files import Step, read_csv
from shsa_learning.recordings.fleet import read_bags
from shsa_learning.recordings.recording import Recording, Series
from shsa_learning.recordings.reservoir import MOST_ROWS


def read(
    paths: Sequence[str],
    som: Optional[Som] = None,
    ontology: Optional[Ontology] = None,
    step: Step = lambda size: None,
    dask: str = "",
    most: int = MOST_ROWS,
) -> Tuple[Recording, ...]:
    """Read recordings from files, or folders of them: rosbags, which need a SOM, and CSV files.

    Several bags are read by a process each, or by the workers of the scheduler at the address
    `dask`. Of the rows of a source `most` are kept, fewer if there are many bags. A bag is a
    recording. CSV files are sources of one recording, unless they cannot be: those of one name in
    several folders are a recording each folder, and so are those that do not overlap in time. Which
    services they are of, `attributed` says. `step` is told of the bytes that are read. Raises
    ShsaError, with the file, if one cannot be read.
    """
    if not paths:
        raise ModelError("the data", "no file is given")
    paths = files(paths)
    twice = [path for k, path in enumerate(paths) if path in paths[:k]]
    if twice:
        raise ModelError(twice[0], "is given twice")
    bags = [path for path in paths if is_bag(path)]
    if bags and som is None:
        raise ModelError(bags[0], "is a rosbag: a SOM (--som) says what its topics provide")
    recordings = read_bags(bags, som or Som(), step, dask, most)
    tables = [path for path in paths if path not in bags]
    return (*recordings, *_recordings(tables, som or Som(), ontology, step, most))


def files(paths: Sequence[str]) -> List[str]:
    """Return the files, where a folder stands for the bags and CSV files in it, by name."""
    found: List[str] = []
    for path in paths:
        if not os.path.isdir(path):
            found.append(path)
            continue
        inside = [name for name in sorted(os.listdir(path)) if name.endswith((".bag", ".csv"))]
        if not inside:
            raise ModelError(path, "is a folder without any .bag or .csv file")
        found += [os.path.join(path, name) for name in inside]
    return found


class _CsvFile(NamedTuple):
    """The series of one CSV file."""

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
    paths: Sequence[str], som: Som, ontology: Optional[Ontology], step: Step, most: int
) -> Tuple[Recording, ...]:
    tables = []
    for path in paths:
        series, notes = read_csv(path, len(paths) == 1, step, most)
        tables.append(_CsvFile(path, series, notes))
    folders: Dict[str, List[_CsvFile]] = {}
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


def _overlapping(tables: Sequence[_CsvFile]) -> List[List[_CsvFile]]:
    """Return the tables in groups that overlap in time, earliest first."""
    groups: List[List[_CsvFile]] = []
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
    """Note the series whose names are no property of the ontology."""
    if ontology is None:
        return []
    notes = []
    for each in series:
        if each.property not in ontology.properties:
            hint = nearest(each.property, ontology.properties)
            notes.append(f"{each.source}: {each.property} is no property of the ontology{hint}")
    return notes


Tables = Sequence[Sequence[Series]]
"""The series of each file."""


def attributed(tables: Tables, som: Som) -> Tuple[List[Tuple[Series, ...]], List[str]]:
    """Give each series the service and the node that it is of; return notes on that.

    A file is of the service that it is named after, or of the only one that provides all of its
    columns; a column, of the only service that provides it. Where several could be meant, the first
    one counts that is not taken.
    """
    notes: List[str] = []
    chosen: List[Dict[str, Service]] = [_certain(table, som) for table in tables]
    taken = {(service.name, name) for found in chosen for name, service in found.items()}
    for table, found in zip(tables, chosen):
        for series in table:
            if series.property not in found:
                service, note = _guessed(series, som, taken)
                notes.append(f"{series.source}: {series.property} {note}")
                if service is not None:
                    found[series.property] = service
                    taken.add((service.name, series.property))
    named = [
        tuple(_of(series, found.get(series.property)) for series in table)
        for table, found in zip(tables, chosen)
    ]
    return named, notes if len(som) else []


def _certain(table: Sequence[Series], som: Som) -> Dict[str, Service]:
    """Return the services of a file's columns, as far as there is no doubt."""
    stem = os.path.splitext(os.path.basename(table[0].source))[0]
    names = {series.property for series in table}
    whole = [service for service in som if names <= set(service.properties)]
    own = som.services.get(stem) or (whole[0] if len(whole) == 1 else None)
    found = {}
    for name in names:
        sources = som.of_property(name)
        if own is not None and own.source(name) is not None:
            found[name] = own
        elif len(sources) == 1:
            found[name] = sources[0].service
    return found


def _guessed(
    series: Series, som: Som, taken: Set[Tuple[str, str]]
) -> Tuple[Optional[Service], str]:
    """Return the service that a column may be of, and what is to be said of it."""
    sources = som.of_property(series.property)
    if not sources:
        return None, "is provided by no service of the SOM"
    names = ", ".join(source.service.name for source in sources)
    for source in sources:
        if (source.service.name, series.property) not in taken:
            service = source.service
            return service, f"is taken for that of {service.name}; name the file after {names}"
    return None, f"is of none of {names}, which other files are of"


def _of(series: Series, service: Optional[Service]) -> Series:
    if service is None:
        return series
    return dataclasses.replace(series, node=service.node, service=service.name)
