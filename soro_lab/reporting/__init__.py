"""Parts of reports that open without a network: HTML, and pictures as data in it."""
