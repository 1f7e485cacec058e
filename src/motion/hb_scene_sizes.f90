!> What the memory that a scene takes depends on.
module hb_scene_sizes
   use hb_coordinates, only: coordinates_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_of_parity
   use hb_law_coordinates, only: laws_at
   use hb_memory_sizes, only: new_sizes, sizes_t
   use hb_scene, only: scene_t
   use hb_scene_coordinates, only: coordinates_of
   use hb_scene_symmetry, only: half_of_odd, is_solved_odd
   use hb_torus, only: default_samples, torus_t
   implicit none
   private
   public :: sizes_of

contains

   !> What the memory of a scene depends on; laws from the first that has a problem on, and a grid with one, do
   !> not count. Neighbours may ask for all tuples.
   type(sizes_t) function sizes_of(self) result(sizes)
      type(scene_t), intent(in) :: self
      type(harmonics_t) :: set
      type(torus_t) :: torus
      type(coordinates_t) :: coordinates
      type(error_t), allocatable :: error
      integer :: n

      do n = 0, size(self%laws) - 1
         if (.not. (allocated(self%laws(n + 1)%law%dofs) .and. allocated(self%laws(n + 1)%law%shape))) exit
      end do
      torus = self%torus
      set = self%harmonics
      if (.not. allocated(torus%n_samples)) then
         torus%n_samples = default_samples(self%harmonics, 1)
      else if (n == size(self%laws) .and. .not. self%chain%is_on) then
         if (is_solved_odd(self)) then
            call new_of_parity(set, self%harmonics, 1, error)         ! that has odd tuples
            torus = half_of_odd(self)
            associate (last => torus%n_samples(size(torus%n_samples)))
               if (torus%is_half) last = last/2
            end associate
         end if
      end if
      coordinates = coordinates_of(self, n)
      call new_sizes(sizes, self%structure, set, torus, laws_at(coordinates, self%laws(:n)), coordinates, &
                     size(self%output%dofs), self%output%samples, self%solver, self%certificate%is_on, any(self%tones%is_unknown))
   end function sizes_of
end module hb_scene_sizes
