-- Settings of SKUs that the office releases, and which station has which of them.

-- Every release, in the order of its SKU.
CREATE TABLE isomark.release (
    -- The name of the SKU as folders and comparisons use it.
    sku text COLLATE "C" NOT NULL CHECK (char_length(sku) BETWEEN 1 AND 200),
    version bigint NOT NULL CHECK (version > 0),
    name text NOT NULL CHECK (char_length(name) BETWEEN 1 AND 100),
    -- The station that it is for; empty for all.
    station text COLLATE "C" NOT NULL CHECK (char_length(station) <= 100),
    -- The text of the settings file, in UTF-8; NULL if the settings were removed.
    body bytea CHECK (octet_length(body) <= 1048576),
    blake3 text COLLATE "C" CHECK (blake3 ~ '^[0-9a-f]{64}$'),
    -- Who released it, as that person wants to be named.
    author text CHECK (char_length(author) BETWEEN 1 AND 100),
    login name NOT NULL,
    at timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (sku, version),
    CHECK ((body IS NULL) = (blake3 IS NULL))
);

-- The newest release of each SKU for all stations, and for each station that has its own.
CREATE TABLE isomark.current_release (
    sku text COLLATE "C" NOT NULL,
    station text COLLATE "C" NOT NULL,
    version bigint NOT NULL,
    -- NULL if the settings were removed.
    blake3 text COLLATE "C",
    PRIMARY KEY (sku, station),
    FOREIGN KEY (sku, version) REFERENCES isomark.release
);

-- What each station does with the release that is for it.
CREATE TABLE isomark.station_release (
    station text NOT NULL REFERENCES isomark.station ON UPDATE CASCADE ON DELETE CASCADE,
    sku text COLLATE "C" NOT NULL CHECK (char_length(sku) BETWEEN 1 AND 200),
    -- The release that it received last.
    version bigint NOT NULL CHECK (version > 0),
    -- Whether it uses it: "used", "local" for a local change that is used, "refused" for settings that are wrong there.
    state text NOT NULL CHECK (state IN ('used', 'local', 'refused')),
    note text CHECK (char_length(note) <= 1000),
    at timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (station, sku)
);

-- Releases settings, or removes them with a body that is NULL. Gives the version, and whether it is new: the same content again
-- makes no version. The version is NULL if there is nothing to remove.
CREATE FUNCTION isomark.release(
    its_sku text, its_name text, its_station text, its_body bytea, its_blake3 text, its_author text
) RETURNS TABLE (version bigint, is_new boolean)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
#variable_conflict use_column
DECLARE
    known isomark.current_release;
    next bigint;
BEGIN
    -- Of two releases of one SKU, one waits here for the other.
    PERFORM pg_advisory_xact_lock(hashtextextended('isomark release ' || its_sku, 0));
    SELECT * INTO known FROM isomark.current_release AS c WHERE c.sku = its_sku AND c.station = its_station;
    IF known.blake3 IS NOT DISTINCT FROM its_blake3 THEN
        RETURN QUERY SELECT known.version, false;
        RETURN;
    END IF;
    SELECT coalesce(max(r.version), 0) + 1 INTO next FROM isomark.release AS r WHERE r.sku = its_sku;
    INSERT INTO isomark.release (sku, version, name, station, body, blake3, author, login)
        VALUES (its_sku, next, its_name, its_station, its_body, its_blake3, its_author, session_user);
    INSERT INTO isomark.current_release AS c VALUES (its_sku, its_station, next, its_blake3)
        ON CONFLICT (sku, station) DO UPDATE SET version = next, blake3 = its_blake3;
    PERFORM pg_notify('isomark', 'settings ' || its_sku);
    RETURN QUERY SELECT next, true;
END $$;

-- Notes what a station does with releases; the arrays have one element for each of them.
CREATE FUNCTION isomark.received(
    its_station text, its_skus text[], its_versions bigint[], its_states text[], its_notes text[]
) RETURNS void LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM isomark.station WHERE name = its_station AND login = session_user) THEN
        RAISE insufficient_privilege USING MESSAGE =
            format('the station name "%s" belongs to another login', its_station);
    END IF;
    INSERT INTO isomark.station_release AS s (station, sku, version, state, note)
        SELECT its_station, u.sku, u.version, u.state, u.note
        FROM unnest(its_skus, its_versions, its_states, its_notes) AS u (sku, version, state, note)
        -- Only what exists: a station cannot fill the table.
        WHERE EXISTS (SELECT FROM isomark.release AS r WHERE r.sku = u.sku AND r.version = u.version)
        ON CONFLICT (station, sku) DO UPDATE
        SET version = EXCLUDED.version, state = EXCLUDED.state, note = EXCLUDED.note, at = now();
END $$;
