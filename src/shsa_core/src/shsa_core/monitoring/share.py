"""Which services a monitor watches where several share the robot: one on each computer."""
from typing import Collection

from shsa_core.model.som import Som


def watched_at(som: Som, host: str) -> Som:
    """The services of the topics of a host."""
    return _of_topics(som, {topic for topic in som.topics() if _home(som, topic) == host})


def watched_beside(som: Som, hosts: Collection[str]) -> Som:
    """The services of all topics but those of hosts that have a monitor of their own."""
    return _of_topics(som, {topic for topic in som.topics() if _home(som, topic) not in hosts})


def _home(som: Som, topic: str) -> str:
    """The host of a topic: that of its first service, so that one monitor hears all publishers."""
    return som.of_topic(topic)[0].host


def _of_topics(som: Som, topics: Collection[str]) -> Som:
    return som.with_services(service for service in som if service.topic in topics)
