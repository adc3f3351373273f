"""Parts of the API that belong to no room: health, news, controls, stop."""
