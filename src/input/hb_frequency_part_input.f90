!> Reads `&dynamic_stiffness`: parts of a structure whose stiffness depends on the frequency.
module hb_frequency_part_input
   use hb_error, only: error_t
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_interpolation, only: is_ascending, new_monotone_cubic
   use hb_kinds, only: wp
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: string_t
   implicit none
   private
   public :: read_frequency_part

contains

   !> Adds the part of a group to the structure; errors are reported as problems of its keys, an unknown kind as an
   !> error.
   subroutine read_frequency_part(group, structure, error)
      type(properties_t), intent(inout) :: group                      !! &dynamic_stiffness
      type(structure_t), intent(inout) :: structure
      type(error_t), allocatable, intent(out) :: error
      type(frequency_part_t) :: part
      type(frequency_part_t), allocatable :: parts(:)
      character(:), allocatable :: label, name
      logical :: is_complete

      call group%get("type", name)
      if (.not. allocated(name)) then
         call group%report_first(error)
         return
      end if
      if (group%given("label")) call group%get("label", label)        ! used by paths
      is_complete = .true.
      select case (name)
      case ("delay")
         part%kind = kind_of_part%delay
         call group%get("stiffness", part%stiffness)
         call group%get("damping", part%damping)
         call group%get("delay", part%delay)
      case ("fractional")
         part%kind = kind_of_part%fractional
         call group%get("coefficient", part%coefficient)
         call group%get("exponent", part%exponent)
      case ("loss_factor")
         part%kind = kind_of_part%loss_factor
         call group%get("stiffness", part%stiffness)
         call group%get("loss_factor", part%loss_factor)
      case ("maxwell")
         part%kind = kind_of_part%maxwell
         call group%get("moduli", part%moduli)
         if (allocated(part%moduli)) call group%get("times", part%times, n=size(part%moduli))
         is_complete = allocated(part%times)
      case ("table")
         call read_table(group, part)
         is_complete = allocated(part%loss%nodes)
      end select
      call read_locations(group, structure, part)
      if (.not. (is_complete .and. allocated(part%feels) .and. allocated(part%acts))) return   ! already reported
      allocate (parts(0))
      if (allocated(structure%parts)) parts = structure%parts
      structure%parts = [parts, part]
   end subroutine read_frequency_part

   !> Reads a table of storage and loss moduli; below its first frequency the loss is proportional to the frequency.
   subroutine read_table(group, part)
      type(properties_t), intent(inout) :: group
      type(frequency_part_t), intent(inout) :: part
      real(wp), allocatable :: frequencies(:), loss(:), storage(:)

      part%kind = kind_of_part%table
      call group%get("frequencies", frequencies)
      if (.not. allocated(frequencies)) return
      call group%get("storage", storage, n=size(frequencies))
      call group%get("loss", loss, n=size(frequencies))
      if (size(frequencies) < 2) then
         call group%problem("frequencies", "a table needs two frequencies or more")
      else if (.not. is_ascending(frequencies) .or. frequencies(1) < 0.0_wp) then
         call group%problem("frequencies", "each must be greater than the one before, the first 0 or more")
      else if (allocated(storage) .and. allocated(loss)) then
         if (size(storage) /= size(frequencies) .or. size(loss) /= size(frequencies)) return
         if (frequencies(1) > 0.0_wp) then
            frequencies = [0.0_wp, frequencies]
            storage = [storage(1), storage]
            loss = [0.0_wp, loss]
         else if (abs(loss(1)) > 0.0_wp) then
            call group%problem("loss", "must be 0 at the frequency 0")
         end if
         call new_monotone_cubic(part%storage, frequencies, storage, is_constant_beyond=.true.)
         call new_monotone_cubic(part%loss, frequencies, loss, is_constant_beyond=.true.)
      end if
   end subroutine read_table

   !> Reads the coordinate of the part and the direction of its force, which is the same by default.
   subroutine read_locations(group, structure, part)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(frequency_part_t), intent(inout) :: part
      character(:), allocatable :: force_name, name
      type(string_t), allocatable :: force_names(:), names(:)
      real(wp), allocatable :: force_weights(:), weights(:)

      if (group%given("dofs")) then
         call group%get("dofs", names)
         if (allocated(names)) call group%get("weights", weights, n=size(names), required=.true.)
      else
         call group%get("dof", name, required=.true.)
      end if
      call find_vector(group, structure, "", name, names, weights, part%feels)
      if (group%given("force_dofs")) then
         call group%get("force_dofs", force_names)
         if (allocated(force_names)) call group%get("force_weights", force_weights, n=size(force_names), required=.true.)
      else if (group%given("force_dof")) then
         call group%get("force_dof", force_name)
      else if (allocated(part%feels)) then
         part%acts = part%feels
         return
      end if
      call find_vector(group, structure, "force_", force_name, force_names, force_weights, part%acts)
   end subroutine read_locations

   !> A degree of freedom, or several with weights, as a vector over all of them; not allocated if they are
   !> incomplete.
   subroutine find_vector(group, structure, prefix, name, names, weights, vector)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(*), intent(in) :: prefix                              !! of the keys
      character(:), allocatable, intent(in) :: name                   !! of a single one
      type(string_t), allocatable, intent(inout) :: names(:)          !! of several, otherwise not allocated
      real(wp), allocatable, intent(inout) :: weights(:)
      real(wp), allocatable, intent(out) :: vector(:)
      character(:), allocatable :: key
      real(wp), allocatable :: values(:)
      type(error_t), allocatable :: error
      integer :: dof, i

      key = prefix//"dofs"
      if (group%given(prefix//"dof")) then
         if (allocated(names)) call group%problem(key, "give either '"//prefix//"dof' or '"//key//"', not both")
         key = prefix//"dof"
         if (.not. allocated(name)) return
         names = [string_t(name)]
         weights = [1.0_wp]
      end if
      if (.not. (allocated(names) .and. allocated(weights))) return
      if (size(weights) /= size(names)) return
      allocate (values(structure%n_dofs), source=0.0_wp)
      do i = 1, size(names)
         call structure%find_dof(names(i)%value, dof, error)
         if (allocated(error)) then
            call group%problem(key, error%message)
            return
         else if (abs(values(dof)) > 0.0_wp) then
            call group%problem(key, "degree of freedom '"//names(i)%value//"' is named twice")
            return
         end if
         values(dof) = weights(i)
      end do
      if (.not. any(abs(values) > 0.0_wp)) call group%problem(prefix//"weights", "at least one weight must not be zero")
      call move_alloc(values, vector)
   end subroutine find_vector
end module hb_frequency_part_input
