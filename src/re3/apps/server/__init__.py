"""The server of `re3 serve`: sessions, a decoder process for each, REST, WebSocket and the page."""
