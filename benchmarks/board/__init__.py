"""Parts of the scoreboard: its rows, and what is measured for them."""
