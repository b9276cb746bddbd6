-- Fitted surfaces, written once, and the current part of each SKU.

CREATE TABLE isomark.fit (
    -- The key of the surface in the cache of a station: a hash of the part and of the settings of the fit.
    key text COLLATE "C" PRIMARY KEY CHECK (key ~ '^[0-9a-f]{32}$'),
    sku text NOT NULL CHECK (char_length(sku) BETWEEN 1 AND 200),
    -- The hash of the part.
    part text COLLATE "C" NOT NULL CHECK (part ~ '^[0-9a-f]{64}$'),
    body bytea NOT NULL CHECK (octet_length(body) <= 67108864),
    body_blake3 bytea NOT NULL CHECK (octet_length(body_blake3) = 32),
    -- The mesh for pictures.
    mesh bytea CHECK (octet_length(mesh) <= 67108864),
    mesh_blake3 bytea CHECK (octet_length(mesh_blake3) = 32),
    bytes bigint NOT NULL GENERATED ALWAYS AS (octet_length(body) + coalesce(octet_length(mesh), 0)) STORED,
    station text NOT NULL CHECK (char_length(station) BETWEEN 1 AND 100),
    login name NOT NULL DEFAULT session_user,
    at timestamptz NOT NULL DEFAULT now(),
    -- The day of its last use, at least.
    used timestamptz NOT NULL DEFAULT now(),
    CHECK ((mesh IS NULL) = (mesh_blake3 IS NULL))
);
-- Floating-point numbers hardly compress.
ALTER TABLE isomark.fit ALTER COLUMN body SET STORAGE EXTERNAL, ALTER COLUMN mesh SET STORAGE EXTERNAL;
CREATE INDEX fit_used ON isomark.fit (used);
CREATE INDEX fit_part ON isomark.fit (part);

CREATE FUNCTION isomark.tell_of_fit() RETURNS trigger LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    PERFORM pg_notify('isomark', 'fit ' || NEW.key);
    RETURN NULL;
END $$;
CREATE TRIGGER tell_of_fit AFTER INSERT ON isomark.fit FOR EACH ROW EXECUTE FUNCTION isomark.tell_of_fit();

-- Every part that was the current one of its SKU, in the order that all stations agree on.
CREATE TABLE isomark.part_version (
    -- The name of the SKU as folders and comparisons use it.
    sku text COLLATE "C" NOT NULL CHECK (char_length(sku) BETWEEN 1 AND 200),
    version bigint NOT NULL CHECK (version > 0),
    name text NOT NULL CHECK (char_length(name) BETWEEN 1 AND 100),
    file text NOT NULL CHECK (char_length(file) BETWEEN 1 AND 255),
    blake3 text COLLATE "C" NOT NULL CHECK (blake3 ~ '^[0-9a-f]{64}$'),
    has_frame boolean NOT NULL,
    station text NOT NULL CHECK (char_length(station) BETWEEN 1 AND 100),
    login name NOT NULL,
    -- When the station learned it, by the clock of the server.
    learned timestamptz NOT NULL,
    at timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (sku, version)
);
CREATE TABLE isomark.current_part (LIKE isomark.part_version INCLUDING DEFAULTS INCLUDING CONSTRAINTS, PRIMARY KEY (sku));
CREATE INDEX current_part_blake3 ON isomark.current_part (blake3);

-- Makes a part the current one of its SKU, unless a part that was learned later is current already: a station that was cut off
-- for a day must not bring back yesterday's part. Gives the current part, and whether it is the given one.
CREATE FUNCTION isomark.learned(
    its_sku text, its_name text, its_file text, its_blake3 text, it_has_frame boolean, its_station text, its_age_s float8
) RETURNS TABLE (is_current boolean, name text, version bigint, file text, blake3 text, has_frame boolean, station text)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
#variable_conflict use_column
DECLARE
    known isomark.current_part;
    learned_at timestamptz := clock_timestamp() - make_interval(secs => least(greatest(its_age_s, 0), 1e9));
BEGIN
    -- Of two stations that learn the first part of a SKU, one waits here for the other.
    INSERT INTO isomark.current_part VALUES (
        its_sku, 1, its_name, its_file, its_blake3, it_has_frame, its_station, session_user, learned_at
    ) ON CONFLICT (sku) DO NOTHING RETURNING * INTO known;
    IF NOT FOUND THEN
        SELECT * INTO STRICT known FROM isomark.current_part AS c WHERE c.sku = its_sku FOR UPDATE;
        IF known.blake3 = its_blake3 THEN
            UPDATE isomark.current_part AS c SET learned = greatest(c.learned, learned_at) WHERE c.sku = its_sku;
            RETURN QUERY SELECT true, known.name, known.version, known.file, known.blake3, known.has_frame, known.station;
            RETURN;
        ELSIF learned_at < known.learned THEN
            RETURN QUERY SELECT false, known.name, known.version, known.file, known.blake3, known.has_frame, known.station;
            RETURN;
        END IF;
        UPDATE isomark.current_part AS c SET
            version = known.version + 1, name = its_name, file = its_file, blake3 = its_blake3,
            has_frame = it_has_frame, station = its_station, login = session_user, learned = learned_at, at = now()
        WHERE c.sku = its_sku RETURNING * INTO known;
    END IF;
    INSERT INTO isomark.part_version SELECT known.*;
    PERFORM pg_notify('isomark', 'part ' || its_sku);
    RETURN QUERY SELECT true, known.name, known.version, known.file, known.blake3, known.has_frame, known.station;
END $$;
