"""Which services of a SOM the series of CSV files are of."""
import dataclasses
import os
from typing import Dict, List, Optional, Sequence, Set, Tuple

from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_learning.recordings.recording import Series

Tables = Sequence[Sequence[Series]]
"""The series of each file."""


def attributed(tables: Tables, som: Som) -> Tuple[List[Tuple[Series, ...]], List[str]]:
    """The series with the service and the node that they are of, and what is to be said of that.

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
    """The services of a file's columns, as far as there is no doubt."""
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
    """The service that a column may be of, and what is to be said of it."""
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
