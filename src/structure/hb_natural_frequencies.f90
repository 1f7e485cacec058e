!> Natural frequencies of a linear structure, of moderate size, in vacuum: without damping, dynamic stiffness or laws.
module hb_natural_frequencies
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_modes, only: modes_t, natural_frequencies, new_modes
   use hb_structure, only: structure_t
   implicit none
   private
   public :: find_natural_frequencies, max_dofs

   integer, parameter :: max_dofs = 1500               !! all frequencies are computed at once, in some seconds
   integer, parameter :: max_gyroscopic_dofs = 200     ! likewise, with gyroscopic terms

contains

   !> Finds the natural frequencies in ascending order, with gyroscopic terms for structures of up to 200 degrees of freedom, as far
   !> as a reduced structure is valid. None for large or sparse structures, or if some part has neither mass nor support. A negative
   !> one is the growth rate of an unstable structure.
   subroutine find_natural_frequencies(structure, frequencies, lacks_gyroscopic)
      type(structure_t), intent(in) :: structure
      real(wp), allocatable, intent(out) :: frequencies(:)            !! [rad/s]
      logical, intent(out) :: lacks_gyroscopic                        !! gyroscopic terms exist and are left out
      type(error_t), allocatable :: error
      type(modes_t) :: modes

      allocate (frequencies(0))
      lacks_gyroscopic = .false.
      if (structure%n_dofs > max_dofs .or. allocated(structure%sparse)) return
      deallocate (frequencies)
      lacks_gyroscopic = any(abs(structure%damping - transpose(structure%damping)) > 0.0_wp)
      if (lacks_gyroscopic .and. structure%n_dofs <= max_gyroscopic_dofs) then
         call new_modes(modes, structure%mass, 0.5_wp*(structure%damping - transpose(structure%damping)), structure%stiffness, &
                        error)
         if (.not. allocated(error)) frequencies = modes%frequency
      end if
      lacks_gyroscopic = lacks_gyroscopic .and. .not. allocated(frequencies)
      if (.not. allocated(frequencies)) frequencies = natural_frequencies(structure%mass, structure%stiffness)
      if (structure%up_to > 0.0_wp) frequencies = pack(frequencies, frequencies <= structure%up_to)
   end subroutine find_natural_frequencies
end module hb_natural_frequencies
