!> The HDF5 file of a time integration: record, coefficients, and the state from which it can be continued.
!>
!> One process writes it whole under a temporary name and then renames it. docs/user/schema.md lists its contents.
module hb_integration_file
   use hb_error, only: annotate, error_t
   use hb_file_columns, only: amplitude_convention, file_columns_t
   use hb_file_location, only: check_target, give_final_name
   use hb_hdf5, only: create_file, h5_dataset_t, h5_file_t, open_file
   use hb_integration, only: integration_t
   use hb_integration_laws, only: integration_laws_t
   use hb_integration_system, only: integration_state_t
   use hb_kinds, only: wp
   use hb_operating_system, only: process_id, remove_file, utc_now
   use hb_record_columns, only: record_columns
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: integration_origin_t, read_integration_state, write_integration_file

   integer, parameter :: schema_version = 1

   !> The origin of a record.
   type :: integration_origin_t
      character(:), allocatable :: title, method, input_text, input_complete
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      integer, allocatable :: retained_dofs(:)
   end type integration_origin_t

   !> A file in the making, which takes the columns of the table.
   type, extends(file_columns_t) :: writer_t
      type(h5_file_t) :: file
      type(error_t), allocatable :: error
   contains
      procedure :: integer => writer_integer
      procedure :: real => writer_real
      procedure :: text => writer_text
   end type writer_t

contains

   !> Writes the file; refuses an existing one unless `overwrite`.
   subroutine write_integration_file(path, overwrite, origin, structure, laws, content, error)
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite
      type(integration_origin_t), intent(in) :: origin
      type(structure_t), intent(in) :: structure
      type(integration_laws_t), intent(in) :: laws
      type(integration_t), intent(in) :: content
      type(error_t), allocatable, intent(out) :: error
      type(writer_t) :: writer
      character(:), allocatable :: temporary

      call check_target(path, overwrite, error)
      temporary = path//"."//to_text(process_id())//".part"
      if (.not. allocated(error)) then
         call create_file(writer%file, temporary, .true., error)
         if (.not. allocated(error)) call write_attributes(writer%file, origin, error)
         call list_axes(writer, origin, structure, laws, content)
         call writer%write_scales(writer%file, error)
         call move_alloc(error, writer%error)
         call record_columns(writer, content, origin%tuples)
         call move_alloc(writer%error, error)
         call writer%file%store("input_text", origin%input_text, "the input as given", error)
         call writer%file%store("input_complete", origin%input_complete, "the input after defaults", error)
         call writer%file%close(error)
         if (.not. allocated(error)) call give_final_name(temporary, path, overwrite, error)
         if (allocated(error)) call remove_file(temporary)
      end if
      call annotate(error, "time integration record '"//path//"'")
   end subroutine write_integration_file

   subroutine write_attributes(file, origin, error)
      type(h5_file_t), intent(in) :: file
      type(integration_origin_t), intent(in) :: origin
      type(error_t), allocatable, intent(out) :: error

      call file%set_attribute("schema_version", schema_version, error)
      call set("kind", "integration")
      call set("method", origin%method)
      call set("program_version", program_version)
      call set("git_commit", git_commit)
      call set("created_utc", utc_now())
      call set("title", origin%title)
      call set("amplitude_convention", amplitude_convention)
   contains
      subroutine set(name, value)
         character(*), intent(in) :: name, value

         if (.not. allocated(error)) call file%set_attribute(name, value, error)
      end subroutine set
   end subroutine write_attributes

   !> All dimensions of the file.
   subroutine list_axes(self, origin, structure, laws, content)
      type(writer_t), intent(inout) :: self
      type(integration_origin_t), intent(in) :: origin
      type(structure_t), intent(in) :: structure
      type(integration_laws_t), intent(in) :: laws
      type(integration_t), intent(in) :: content

      call self%add_axis("time", size(content%record%time), "time")
      self%axes(1)%values = content%record%time
      self%axes(1)%units = "s"
      associate (retained => origin%retained_dofs)
         call self%add_axis("dof", size(retained), "label of the degree of freedom", structure%labels(retained), &
                            structure%units(retained))
      end associate
      if (laws%n_coordinates > 0) &
         call self%add_axis("law_coordinate", laws%n_coordinates, "coordinate of a law", laws%coordinate_labels())
      call self%add_axis("harmonic", size(origin%tuples, 2), "number of the harmonic")
      if (size(origin%tuples, 1) > 0) call self%add_axis("tone", size(origin%tuples, 1), "number of the tone", first=1)
      call self%add_axis("component", 2, "cosine or sine", ["cos", "sin"])
      associate (n => size(content%assessment%frequencies, 1))
         if (n > 0) call self%add_axis("peak", n, "number of the line, the largest first", first=1)
      end associate
      call self%add_axis("state_dof", structure%n_dofs, "label of the degree of freedom", structure%labels, structure%units)
      if (laws%n_states > 0) call self%add_axis("slider", laws%n_states, "number of the state of a law with memory", first=1)
      if (.not. allocated(content%motion)) return
      call self%add_axis("start", size(content%motion), "number of the start", first=1)
      call self%add_axis("motion", size(content%motions), "number of the motion", first=1)
   end subroutine list_axes

   !> Writes a column of real numbers, unless it is a scale or empty.
   subroutine writer_real(self, name, units, axes, long_name, values)
      class(writer_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      real(wp), intent(in), contiguous, optional :: values(..)
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: list, shared
      integer, allocatable :: along(:)

      if (self%axis_index(name) > 0 .or. size(values) == 0) return
      call self%find_axes(axes, along)
      call self%find_units(units, along, shared, list)
      call self%file%store(name, values, self%axes(along)%scale, shared, long_name, self%error, dataset)
      if (allocated(list) .and. .not. allocated(self%error)) call dataset%set_attribute("dof_units", list, self%error)
   end subroutine writer_real

   !> Writes a column of integers.
   subroutine writer_integer(self, name, units, axes, long_name, values, flags, lowest)
      class(writer_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      integer, intent(in), contiguous, optional :: values(..)
      character(*), intent(in), optional :: flags(:)
      integer, intent(in), optional :: lowest
      integer, allocatable :: along(:)

      call self%find_axes(axes, along)
      call self%file%store(name, values, self%axes(along)%scale, units, long_name, self%error)
   end subroutine writer_integer

   !> Records have no columns of texts.
   subroutine writer_text(self, name, units, axes, long_name, value)
      class(writer_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      character(*), intent(in), optional :: value
   end subroutine writer_text

   !> Reads the last state of a record; fails unless it has the same structure and laws.
   subroutine read_integration_state(path, state, error)
      character(*), intent(in) :: path
      type(integration_state_t), intent(inout) :: state               !! with the correct sizes
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      real(wp), allocatable :: time(:)
      integer :: n_dofs, n_states

      call open_file(file, path, error)
      if (allocated(error)) return
      n_dofs = size(state%q)
      n_states = size(state%s)
      call file%get("state_time", time, error, [1])
      call file%get("state_displacement", state%q, error, [n_dofs])
      call file%get("state_velocity", state%v, error, [n_dofs])
      if (n_states > 0) call file%get("state_slider", state%s, error, [n_states])
      call annotate(error, "no record, or a record of another model")
      call file%close(error)
      if (.not. allocated(error)) state%time = time(1)
      call annotate(error, "&integration continue")
   end subroutine read_integration_state
end module hb_integration_file
