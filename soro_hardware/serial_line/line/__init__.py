"""One device on a serial line: requests, answers, and the port below them."""
