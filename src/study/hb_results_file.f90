!> Creates a complete result file before the first point is solved; by one process.
module hb_results_file
   use, intrinsic :: iso_fortran_env, only: int8
   use hb_checksum, only: checksum, checksum_of_zeros
   use hb_error, only: annotate, error_t, fail
   use hb_file_columns, only: amplitude_convention
   use hb_file_location, only: check_target, give_final_name
   use hb_hdf5, only: bytes_of_kind, create_file, h5_dataset_t, h5_file_t, is_characters
   use hb_kinds, only: int64, wp
   use hb_operating_system, only: finish_file, has_space, lock_file, remove_file, sync_file, unlock_file, utc_now
   use hb_parameter_path, only: identifier
   use hb_result_columns, only: bytes_of_row, column_t, measure_row, plan_t, tuple_entry_name
   use hb_results_layout, only: results_layout_t, swept_parameter_t
   use hb_signals, only: note_unfinished
   use hb_text, only: to_text
   implicit none
   private
   public :: copied_file_t, make_file, schema_version

   !> A file whose rows are copied into a new one.
   type :: copied_file_t
      type(h5_file_t) :: file
      integer, allocatable :: rows(:)                                 !! of this file, for each row of the new one; 0: none yet
      integer :: first_rank = 1                                       !! of the new file, which is the first of this one
      integer :: n_ranks = 0                                          !! 0: as many as the new file has
   end type copied_file_t

   real(wp), parameter :: max_bytes = 1.6e7_wp                       ! [B] of rows that are copied together

   integer, parameter :: schema_version = 1
   integer, parameter :: parameter_name_length = 256                  ! longer than any path of an input

contains

   !> Creates the whole file under another name beside `path`, then renames it.
   !> The other name is the same for all runs. It is locked while the file is created, and a lock ends with its
   !> process: the remains of a killed run are replaced, the file of a running process is not.
   subroutine make_file(path, layout, plan, overwrite, error, sources)
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(inout) :: plan
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      type(copied_file_t), intent(in), optional :: sources(:)         !! of rows; else there are none yet
      character(:), allocatable :: temporary
      integer(int64) :: n_bytes
      integer :: descriptor
      logical :: ok

      call check_target(path, overwrite, error, is_own=present(sources))
      if (allocated(error)) return
      temporary = path//".part"
      call lock_file(temporary, descriptor, error)
      if (allocated(error)) return
      call note_unfinished(temporary)
      n_bytes = n_bytes_of(plan, layout)
      if (has_space(descriptor, n_bytes)) then
         call fill_file(temporary, layout, plan, error, sources)
      else
         call fail(error, "no space left on device, or more than a quota or limit allows")
      end if
      if (.not. allocated(error)) then
         call sync_file(temporary, ok)
         if (.not. ok) call fail(error, "the system cannot bring its data to the disk")
      end if
      if (allocated(error)) then
         error%message = "cannot be made; check permission and space ("//size_text(n_bytes)// &
            ") or give another --output: "//error%message
      else
         call finish_file(descriptor)
         call give_final_name(temporary, path, overwrite, error, is_own=present(sources))
      end if
      if (allocated(error)) call remove_file(temporary)
      call note_unfinished("")
      call unlock_file(descriptor)
   end subroutine make_file

   !> Upper estimate of the size of a file on the disk in bytes.
   pure function n_bytes_of(plan, layout) result(n_bytes)
      type(plan_t), intent(in) :: plan
      type(results_layout_t), intent(in) :: layout
      integer(int64) :: n_bytes
      integer(int64), parameter :: of_one_dataset = 4000, of_a_text = 100 ! description of a dataset; a label or text value
      integer :: i

      n_bytes = of_one_dataset*(size(plan%columns) + size(plan%times) + size(plan%axes) + &
         size(layout%parameters) + size(layout%tuples, 1) + 8)
      do i = 1, size(plan%columns)
         if (plan%columns(i)%is_part_used) cycle                      ! nothing is allocated yet
         n_bytes = n_bytes + layout%n_points*bytes_of_row(plan, plan%columns(i))
      end do
      do i = 1, size(plan%times)
         n_bytes = n_bytes + bytes_of_kind(plan%times(i)%kind)*int(layout%n_ranks, int64)
      end do
      n_bytes = n_bytes + 8*sum(int(plan%axes%length, int64)) + 8*size(layout%tuples, kind=int64) + &
         of_a_text*(size(layout%dof_labels) + size(layout%law_dof_labels) + size(layout%law_labels) + &
                    size(layout%output_names))
      do i = 1, size(layout%parameters)
         n_bytes = n_bytes + layout%n_points*merge(of_a_text, 8_int64, layout%parameters(i)%is_text)
      end do
      if (allocated(layout%input_text)) n_bytes = n_bytes + len(layout%input_text)
      if (allocated(layout%input_complete)) n_bytes = n_bytes + len(layout%input_complete)
   end function n_bytes_of

   !> Formats a number of bytes for messages.
   function size_text(n_bytes) result(text)
      integer(int64), intent(in) :: n_bytes
      character(:), allocatable :: text
      character(40) :: digits

      write (digits, "(f0.1)") max(0.1_wp, real(n_bytes, wp)/1.0e6_wp)
      text = trim(digits)//" MB"
      if (text(1:1) == ".") text = "0"//text
   end function size_text

   !> Creates the file and closes it.
   subroutine fill_file(path, layout, plan, error, sources)
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(inout) :: plan
      type(error_t), allocatable, intent(out) :: error
      type(copied_file_t), intent(in), optional :: sources(:)
      type(h5_file_t) :: file
      integer :: i

      call create_file(file, path, .true., error)
      if (.not. allocated(error)) call add_root_attributes(file, layout, error)
      call plan%write_scales(file, error)
      if (.not. allocated(error)) call add_inputs(file, layout, plan, error)
      if (.not. allocated(error)) call add_columns(file, plan, plan%columns, error)
      if (.not. allocated(error)) call add_columns(file, plan, plan%times, error)
      if (present(sources)) then
         do i = 1, size(sources)
            if (.not. allocated(error)) call copy_rows(sources(i), plan, error)
         end do
      end if
      call file%close(error)
   end subroutine fill_file

   subroutine add_root_attributes(file, layout, error)
      type(h5_file_t), intent(in) :: file
      type(results_layout_t), intent(in) :: layout
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call file%set_attribute("schema_version", schema_version, error)
      if (.not. allocated(error)) call file%set_attribute("n_ranks", layout%n_ranks, error)
      call set_text("program_version", or_empty(layout%program_version))
      call set_text("git_commit", or_empty(layout%git_commit))
      call set_text("created_utc", utc_now())
      call set_text("title", or_empty(layout%title))
      call set_text("amplitude_convention", amplitude_convention)
      if (.not. allocated(layout%numbers)) return
      do i = 1, size(layout%numbers)
         if (.not. allocated(error)) call file%set_attribute(trim(layout%numbers(i)%name), layout%numbers(i)%value, error)
      end do
   contains
      subroutine set_text(name, value)
         character(*), intent(in) :: name, value

         if (.not. allocated(error)) call file%set_attribute(name, value, error)
      end subroutine set_text
   end subroutine add_root_attributes

   !> Adds the data that are known before the run: tuples, swept parameters, input files.
   subroutine add_inputs(file, layout, plan, error)
      type(h5_file_t), intent(in) :: file
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(in) :: plan
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      character(parameter_name_length) :: names(size(layout%parameters))
      integer, allocatable :: entries(:)
      integer :: i

      associate (tone => plan%axes(plan%axis_index("tone"))%scale, harmonic => plan%axes(plan%axis_index("harmonic"))%scale)
         if (.not. layout%has_own_tuples) &
            call file%store("tuple", layout%tuples, [tone, harmonic], "1", "integer tuple j of each harmonic", error)
         names = parameter_names(layout, plan)
         do i = 1, size(names)
            call add_parameter(file, trim(names(i)), layout%parameters(i), plan, error)
         end do
         do i = 1, merge(0, size(layout%tuples, 1), layout%has_own_tuples)   ! xarray selects by an index, not by rows
            entries = layout%tuples(i, :)
            call file%store(tuple_entry_name(i), entries, [harmonic], "1", "entry of the tuple for tone "//to_text(i), error)
         end do
      end associate
      if (allocated(error)) return
      if (allocated(layout%curve_parameter)) then
         call file%set_attribute("coordinates", coordinate_names(layout, [character(parameter_name_length) :: &
            names, identifier(layout%curve_parameter)]), error)
      else
         call file%set_attribute("coordinates", coordinate_names(layout, names), error)
      end if
      call file%store("input_text", or_empty(layout%input_text), "the input as given", error, dataset)
      if (.not. allocated(error)) call dataset%set_attribute("file_name", or_empty(layout%input_name), error)
      if (.not. allocated(error)) call dataset%set_attribute("folder", or_empty(layout%input_folder), error)
      call file%store("input_overrides", or_empty(layout%input_overrides), "path=value of each --set, a line each", error)
      call file%store("input_complete", or_empty(layout%input_complete), "the input after defaults", error)
      call file%store("input_libraries", or_empty(layout%input_libraries), &
         "libraries of the laws, checksum and length, a line each", error)
   end subroutine add_inputs

   !> Variable names of the swept parameters: the path in lower case with one underscore for every sequence of other
   !> characters; a number is added if the name is already used.
   function parameter_names(layout, plan) result(names)
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(in) :: plan
      character(parameter_name_length) :: names(size(layout%parameters))
      character(:), allocatable :: stem
      integer :: i, n

      do i = 1, size(names)
         stem = identifier(layout%parameters(i)%path)
         if (stem == "") stem = "parameter"
         names(i) = stem
         n = 1
         do while (is_taken(trim(names(i))) .or. any(names(:i - 1) == names(i)))
            n = n + 1
            names(i) = stem//"_"//to_text(n)
         end do
      end do

   contains

      pure logical function is_taken(name)
         character(*), intent(in) :: name
         character(*), parameter :: others(6) = [character(15) :: "tuple", "input_text", "input_overrides", "input_complete", &
                                                 "input_libraries", "tuples"]
         integer :: k

         is_taken = plan%index_of(name) > 0 .or. plan%axis_index(name) > 0 .or. any(others == name) .or. &
            any([(plan%times(k)%name == name, k=1, size(plan%times))]) .or. &
            any([(tuple_entry_name(k) == name, k=1, size(layout%tuples, 1))])
      end function is_taken
   end function parameter_names

   !> Names of the coordinates of points and harmonics, separated by blanks (CF convention).
   function coordinate_names(layout, parameters) result(text)
      type(results_layout_t), intent(in) :: layout
      character(*), intent(in) :: parameters(:)
      character(:), allocatable :: text
      integer :: i

      text = "frequency tuple"
      if (layout%has_own_tuples) text = "frequency tuples"
      do i = 1, merge(0, size(layout%tuples, 1), layout%has_own_tuples)
         text = text//" "//tuple_entry_name(i)
      end do
      do i = 1, size(parameters)
         text = text//" "//trim(parameters(i))
      end do
   end function coordinate_names

   subroutine add_parameter(file, name, parameter, plan, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      type(swept_parameter_t), intent(in) :: parameter
      type(plan_t), intent(in) :: plan
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: what

      if (allocated(error)) return
      what = "swept parameter "//parameter%path
      associate (point => plan%axes(plan%axis_index("point"))%scale)
         if (parameter%is_text) then
            call file%add_texts(name, parameter%text_values, dataset, error)
            call dataset%describe(or_empty(parameter%units), what, error, [point])
         else
            call file%store(name, parameter%values, [point], or_empty(parameter%units), what, error, dataset)
         end if
      end associate
      if (.not. allocated(error)) call dataset%set_attribute("parameter", parameter%path, error)
   end subroutine add_parameter

   subroutine add_columns(file, plan, columns, error)
      type(h5_file_t), intent(in) :: file
      type(plan_t), intent(in) :: plan
      type(column_t), intent(inout) :: columns(:)                     !! of the plan
      type(error_t), allocatable, intent(out) :: error
      integer :: i, k

      do i = 1, size(columns)
         associate (column => columns(i), dataset => columns(i)%dataset)
            call file%add(column%name, column%kind, plan%extents_of(column), dataset, error, column%is_part_used)
            call dataset%describe(column%units, column%long_name, error, plan%axes(column%axes)%scale)
            if (allocated(column%dof_units)) call set_text(dataset, "dof_units", column%dof_units)
            if (column%kind == is_characters) call set_text(dataset, "_Encoding", "utf-8")
            if (column%name == "checksum") call set_text(dataset, "of", names_of_checked(columns))
            if (allocated(column%flags) .and. .not. allocated(error)) then ! CF convention
               call dataset%set_attribute("flag_values", [(column%lowest_flag + k, k=0, column%n_flags - 1)], error)
               call set_text(dataset, "flag_meanings", column%flags)
            end if
            if (allocated(column%attributes)) then
               do k = 1, size(column%attributes)
                  call set_text(dataset, column%attributes(k)%name, column%attributes(k)%text)
               end do
            end if
            if (allocated(column%parameter)) call set_text(dataset, "parameter", column%parameter)
            if (allocated(column%parameter)) call set_text(dataset, "moves_along", "curve")
         end associate
         if (allocated(error)) return
      end do

   contains

      subroutine set_text(dataset, name, value)
         type(h5_dataset_t), intent(in) :: dataset
         character(*), intent(in) :: name, value

         if (.not. allocated(error)) call dataset%set_attribute(name, value, error)
      end subroutine set_text
   end subroutine add_columns

   !> Names of the datasets that the checksum of a row includes, in order, separated by blanks.
   function names_of_checked(columns) result(names)
      type(column_t), intent(in) :: columns(:)
      character(:), allocatable :: names
      integer :: i

      names = ""
      do i = 1, size(columns)
         if (columns(i)%is_checked) names = names//" "//columns(i)%name
      end do
      names = names(2:)
   end function names_of_checked

   !> The text, or an empty one if it is not allocated.
   pure function or_empty(text)
      character(*), intent(in), optional :: text
      character(:), allocatable :: or_empty

      or_empty = ""
      if (present(text)) or_empty = text
   end function or_empty

   !> Copies the rows of points, and those of all ranks. Of the elements for harmonics, and for the continuation of curves, the
   !> first ones are copied, as many as both files have; checksums are computed again.
   subroutine copy_rows(source, plan, error)
      type(copied_file_t), intent(in) :: source
      type(plan_t), intent(in) :: plan                                !! of the new file, with its datasets
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: stored(:), sums(:)
      integer :: first, i, last, n_at_once, n_datasets, n_ranks
      logical :: is_repeated
      real(wp) :: n_bytes

      call measure_row(plan, 0, n_bytes, n_datasets)
      n_at_once = max(1, int(max_bytes/n_bytes))
      first = 1
      do while (first <= size(source%rows))
         last = end_of_rows(source%rows, first, n_at_once)
         if (source%rows(first) > 0) then
            allocate (sums(last - first + 1), source=0)
            is_repeated = last > first .and. source%rows(last) == source%rows(first)
            do i = 1, size(plan%columns)
               call copy(source%file, plan%columns(i), source%rows(first), first, sums, error, is_repeated)
               if (allocated(error)) return
            end do
            associate (of_rows => plan%columns(plan%index_of("checksum"))%dataset)
               allocate (stored, mold=sums)
               call of_rows%read(stored, error, first)
               if (.not. allocated(error)) call of_rows%write(merge(sums, 0, stored /= 0), error, first)
            end associate
            if (allocated(error)) return
            deallocate (stored, sums)
            if (source%first_rank > 1) call shift_ranks(plan, first, last, source%first_rank - 1, error)
            if (allocated(error)) return
         end if
         first = last + 1
      end do
      do i = 1, size(plan%times)
         n_ranks = source%n_ranks
         if (n_ranks == 0) n_ranks = product(plan%times(i)%dataset%get_extents())
         allocate (sums(n_ranks))
         call copy(source%file, plan%times(i), 1, source%first_rank, sums, error)
         if (allocated(error)) return
         deallocate (sums)
      end do
   end subroutine copy_rows

   !> Adds a number to the ranks that have solved points, which begin again in each source.
   subroutine shift_ranks(plan, first, last, by, error)
      type(plan_t), intent(in) :: plan
      integer, intent(in) :: first, last                              !! rows
      integer, intent(in) :: by
      type(error_t), allocatable, intent(out) :: error
      integer :: ranks(last - first + 1)

      associate (dataset => plan%columns(plan%index_of("rank"))%dataset)
         call dataset%read(ranks, error, first)
         if (.not. allocated(error)) call dataset%write(ranks + by, error, first)
      end associate
   end subroutine shift_ranks

   !> Last of the rows from `first` on that are copied together: consecutive ones of the source, one of them repeated, or none.
   pure integer function end_of_rows(rows, first, most) result(last)
      integer, intent(in) :: rows(:), first
      integer, intent(in) :: most
      integer :: step

      last = first
      if (first == size(rows)) return
      step = merge(1, 0, rows(first + 1) /= rows(first))
      do while (last < size(rows) .and. (rows(first) == 0 .or. last - first + 1 < most))
         if (rows(last + 1) /= rows(last) + step .or. (step == 1 .and. rows(last) == 0)) exit
         last = last + 1
      end do
   end function end_of_rows

   !> Copies as many rows of a dataset as there are checksums, which are continued over columns that they include. Of elements of
   !> which rows use a part, the zeros behind it are not written: the rest of a sparse file has no room on the disk.
   subroutine copy(source, column, from, first, sums, error, is_repeated)
      type(h5_file_t), intent(in) :: source
      type(column_t), intent(in) :: column
      integer, intent(in) :: from, first                              !! first row of the source, and of the new file
      integer, intent(inout) :: sums(:)
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: is_repeated                    !! the first row of the source; default: no
      type(h5_dataset_t) :: old
      character(:), allocatable :: meanings
      integer(int8), allocatable :: rows(:, :, :)                     ! bytes of all elements, blocks of them, rows
      integer, allocatable :: extents(:), old_extents(:)
      integer :: i, k, n, n_entry, n_padding, n_rows, part

      call source%open_dataset(column%name, old, error)
      if (allocated(error)) return
      if (allocated(column%flags)) then
         call old%get_attribute("flag_meanings", meanings, error)
         if (.not. allocated(error) .and. meanings /= column%flags) &
            call fail(error, "its numbers mean other things than in this version of the program")
         call annotate(error, "'"//column%name//"'")
         if (allocated(error)) return
      end if
      n_rows = size(sums)
      if (present(is_repeated)) n_rows = merge(1, n_rows, is_repeated)
      extents = column%dataset%get_extents()
      old_extents = old%get_extents()
      extents = extents(:size(extents) - 1)
      if (column%is_part_used) then
         part = min(2, size(extents))                                 ! the axis of which rows use a part
         n = min(extents(part), old_extents(part))
         n_entry = bytes_of_kind(column%kind)*product(extents(:part - 1))
         n_padding = n_entry*(extents(part) - n)
         allocate (rows(n_entry*n, product(extents(part + 1:)), n_rows))
         call old%read(rows, error, from, n)
      else
         n = 1
         n_entry = bytes_of_kind(column%kind)*product(extents)
         n_padding = 0
         allocate (rows(n_entry, 1, n_rows))
         call old%read(rows, error, from)
      end if
      if (n_rows < size(sums)) rows = spread(rows(:, :, 1), 3, size(sums))
      do k = 1, merge(size(sums), 0, column%is_checked .and. .not. allocated(error))
         do i = 1, size(rows, 2)
            sums(k) = checksum_of_zeros(checksum(sums(k), rows(:, i, k)), n_padding)
         end do
      end do
      if (.not. allocated(error)) then
         if (column%is_part_used) then
            do while (n > 0)
               if (any(rows((n - 1)*n_entry + 1:n*n_entry, :, :) /= 0_int8)) exit
               n = n - 1
            end do
            if (n > 0) call column%dataset%write(rows(:n*n_entry, :, :), error, first, n)
         else
            call column%dataset%write(rows, error, first)
         end if
      end if
      call annotate(error, "'"//column%name//"'")
   end subroutine copy
end module hb_results_file
