"""The web service, the panel and the fleet: answers, events, floods, memory."""
