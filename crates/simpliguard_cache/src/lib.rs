//! Content-addressed cache of baked models.
