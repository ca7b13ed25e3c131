"""One HTML page that computes the motion itself: `rigidmc view SCENE --live`, `rigidmc.live`."""
