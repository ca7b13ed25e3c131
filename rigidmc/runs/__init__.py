"""The verbs: simulate, rerun, resume, gather; on threads, shards or workers."""
